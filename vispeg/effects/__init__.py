"""The effect library: a folder for each family, a file for each effect. Importing the package registers them."""

from importlib import import_module
from pkgutil import walk_packages

from vispeg.core.effect import REGISTRY, Effect, Family

for _module in sorted(m.name for m in walk_packages(__path__, f"{__name__}.") if not m.ispkg):
    import_module(_module)


def find(search: str = "", family: Family | None = None) -> list[Effect]:
    """Return the registered effects that match, sorted by name.

    Args:
        search: text that the effect's name, family, class docstring or parameters must contain; case is ignored.
        family: the family of the effects; None for all families.
    """
    words = search.lower()
    chosen = [e for _, e in sorted(REGISTRY.items()) if family in (None, e.family)]
    return [e for e in chosen if words in _text(e)]


def _text(effect: Effect) -> str:
    parts = [effect.name, effect.family, type(effect).__doc__ or ""]
    parts += [text for name, param in effect.params.items() for text in (name, param.doc)]
    text = " ".join(parts).lower()
    return f"{text} {text.replace('_', ' ')}"
