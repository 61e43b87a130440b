"""What a lens, its place and what stands before it make of a picture."""
