"""What comes with the package: worlds, policies, motions, and what an effect does."""
