"""Lists of what comes with the package: effects, robots, worlds, policies and motions."""
