"""The only package that knows both the bench and the model: command line, figures, service."""
