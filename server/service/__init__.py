"""The model service: it keeps readings, predicts, compares, refits and diagnoses, and tells everybody live."""
