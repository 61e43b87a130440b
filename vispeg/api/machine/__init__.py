"""Check what vispeg needs of this machine, using only the standard library."""
