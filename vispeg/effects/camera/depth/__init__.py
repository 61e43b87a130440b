"""What a depth sensor makes of distances."""
