"""Pictures as evidence: what a camera's frames say about the cell, the camera and the arm."""
