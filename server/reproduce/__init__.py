"""Published studies: their numbers beside ours."""
