"""`vispeg measure`: joints and objects, each with its uncertainty."""
