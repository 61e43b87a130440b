"""Commands about this machine: what it lacks, which graphics it has, what its shell completes."""
