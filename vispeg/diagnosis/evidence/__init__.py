"""What the recordings say before anything is fitted: where the model fails, and what each effect would explain."""
