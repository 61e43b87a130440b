"""One section of the report a file: its TITLE, and `context(record)`, the values its template shows (None: nothing).

The template of `sections/NAME.py` is `templates/sections/NAME.html.j2`. A section is added by writing the two files and
naming it here.
"""

DIAGNOSIS = (
    "headline",
    "measured_vs_model",
    "maps",
    "parameters",
    "candidates",
    "confusions",
    "next_experiment",
    "where_it_fails",
    "rendered",
    "provenance",
)
COMPARE = ("headline", "measured_vs_model", "maps", "where_it_fails", "provenance")
