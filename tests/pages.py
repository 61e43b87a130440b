"""Pages of results as a reader takes them."""


def plain(html: str) -> str:
    """Return HTML with ordinary blanks in place of those that do not break, between a number and its unit."""
    return html.replace("\N{NO-BREAK SPACE}", " ")
