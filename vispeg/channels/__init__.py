"""The channels, each in one file or folder here. Importing this package imports them all, and so enrols them."""

from importlib import import_module
from pkgutil import walk_packages

for _module in sorted(m.name for m in walk_packages(__path__, f"{__name__}.")):
    import_module(_module)
