"""A finger that moves: inertia of its segments, recorded movements, and the joint torques behind them."""
