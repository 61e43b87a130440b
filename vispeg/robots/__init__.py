"""Robots, tools and cells as MuJoCo models."""

from vispeg.robots.log import keep_quiet

keep_quiet()
