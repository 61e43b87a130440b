"""Finds Chromium: named by `CHROMIUM`, the system's, or Playwright's download. Run as a script, it prints the path."""

import os
import shutil
import sys
from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome")


def chromium() -> str | None:
    """Return the path of the browser; None where there is none."""
    paths = [os.environ.get("CHROMIUM"), *map(shutil.which, NAMES), _downloaded()]
    return next((path for path in paths if path and Path(path).is_file()), None)


def _downloaded() -> str | None:
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        return None
    with sync_playwright() as driver:
        return driver.chromium.executable_path


if __name__ == "__main__":
    path = chromium()
    print(path or "none")
    sys.exit(path is None)
