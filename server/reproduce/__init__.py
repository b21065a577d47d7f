"""Published studies: their numbers beside ours. Built on the model and figures, asked for by the application."""
