"""The effect library: a folder for each family, one file an effect; every module of a family enrols what it defines."""

from importlib import import_module
from pkgutil import walk_packages

for _module in sorted(m.name for m in walk_packages(__path__, f"{__name__}.") if m.name.count(".") == 3):
    import_module(_module)
