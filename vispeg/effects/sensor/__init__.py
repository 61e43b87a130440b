"""What encoders and the wrist's force sensor make of the truth."""
