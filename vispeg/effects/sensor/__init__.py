"""Effects of encoders and of the wrist's force sensor: offsets, noise, delays, quantization and lost readings."""
