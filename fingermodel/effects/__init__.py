"""The catalogue of physical effects that a model may lack, one file each, and effects of the user."""
