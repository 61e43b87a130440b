"""Effects of exposure and delivery times: latency, lost frames, motion blur and rolling shutter."""
