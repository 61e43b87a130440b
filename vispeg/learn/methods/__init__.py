"""How a policy learns: reinforcement, imitation, both, by stages."""
