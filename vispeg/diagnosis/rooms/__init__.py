"""One diagnosis over several rooms, each with what the others named."""
