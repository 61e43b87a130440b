"""The effect library: a folder for each family, one file an effect; every module below here enrols what it defines."""

from importlib import import_module
from pkgutil import walk_packages

from vispeg.core.effect import REGISTRY, Effect, Family

for _module in sorted(m.name for m in walk_packages(__path__, f"{__name__}.") if not m.ispkg):
    import_module(_module)


def find(search: str = "", family: Family | None = None) -> list[Effect]:
    """Give the registered effects, by name.

    Args:
        search: a text that name, first lines or parameters must have in them, in any case.
        family: one alone.
    """
    words = search.lower()
    chosen = [e for _, e in sorted(REGISTRY.items()) if family in (None, e.family)]
    return [e for e in chosen if words in _text(e)]


def _text(effect: Effect) -> str:
    parts = [effect.name, effect.family, type(effect).__doc__ or ""]
    parts += [text for name, param in effect.params.items() for text in (name, param.doc)]
    return " ".join(parts).lower().replace("_", " ") + " " + effect.name
