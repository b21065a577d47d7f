"""Background work of the service: worker processes, jobs that are kept, and population runs."""
