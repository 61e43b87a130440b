"""What a policy learns from: replay, demonstrations, datasets."""
