"""A published identification protocol, and intervals of the parameters it fits."""
