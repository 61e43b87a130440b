"""What the recordings show before an effect is fitted: where the model fails, how much each effect would explain."""
