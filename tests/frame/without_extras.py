"""Runs command lines as an environment without any extra would; a child process of test_without_extras.

python without_extras.py < [[command, argument, ..], ..] > [[exit status, stderr], ..]
"""

import contextlib
import importlib.abc
import io
import json
import sys

from vispeg.cli.main import main
from vispeg.core.extras import EXTRAS

AWAY = {module for modules in EXTRAS.values() for module in modules}


class Away(importlib.abc.MetaPathFinder):
    """Says of the extras' modules what Python says of those that are not installed."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in AWAY:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


sys.meta_path.insert(0, Away())
found = []
for argv in json.load(sys.stdin):
    err = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(err):
        try:
            code = main(argv)
        except BaseException as error:  # a traceback for the user
            code = repr(error)
    found.append([code, err.getvalue()])
print(json.dumps(found))
