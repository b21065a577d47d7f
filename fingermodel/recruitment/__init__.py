"""Which muscles carry a joint torque: moment arms of whole muscles, and the sharing among them."""
