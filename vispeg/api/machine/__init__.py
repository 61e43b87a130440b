"""What this machine has, as far as vispeg needs it; nothing here needs more than the standard library."""
