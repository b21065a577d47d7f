"""What is said, read off the posterior: verdict, predictive check, sensitivity, faults of the session, hints."""
