"""One section of the report a file: its TITLE, and `context(record)`, the values its template shows (None: nothing).

The template of `sections/NAME.py` is `templates/sections/NAME.html.j2`. A section is added by writing the two files and
naming it here. One that answers the mouse names its SCRIPTS and STYLES, files of templates/; where its values say
`still`, it has nothing to answer with.
"""

DIAGNOSIS = (
    "headline",
    "found",
    "explore",
    "where_it_fails",
    "measured_vs_model",
    "maps",
    "pictures",
    "unseen",
    "proposal",
    "candidates",
    "confusions",
    "next_experiment",
    "rendered",
    "provenance",
)
COMPARE = ("headline", "drift", "explore", "where_it_fails", "measured_vs_model", "maps", "pictures", "provenance")
FIT = ("headline", "found", "doubts", "measured_vs_model", "provenance")
OBJECT = ("headline", "found", "restarts", "candidates", "confusions", "next_experiment", "provenance")
VIEWS = ("headline", "found", "views", "unseen", "candidates", "confusions", "next_experiment", "provenance")
CONTACT = (
    "headline",
    "found",
    "wrench",
    "where_it_fails",
    "unseen",
    "candidates",
    "confusions",
    "next_experiment",
    "provenance",
)
CONTACT_COMPARE = ("headline", "wrench", "where_it_fails", "pictures", "provenance")
CHANNELS = ("headline", "channels", "found", "next_experiment")  # of several channels; then what each of them shows
SHARED = ("headline", "found", "next_experiment", "provenance")  # sections that a page of several channels has once
