"""When a picture is taken, and what moves meanwhile."""
