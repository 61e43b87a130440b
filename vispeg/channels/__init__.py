"""The channels: one file or folder a channel; every module here enrols what it defines."""

from importlib import import_module
from pkgutil import walk_packages

for _module in sorted(m.name for m in walk_packages(__path__, f"{__name__}.")):
    import_module(_module)
