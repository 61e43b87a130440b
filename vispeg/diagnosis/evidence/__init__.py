"""Evidence before any fit: where the model fails, and how much each effect would explain."""
