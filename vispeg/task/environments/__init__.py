"""A task as it runs: batched episodes, gymnasium environments, what a diverged episode leaves."""
