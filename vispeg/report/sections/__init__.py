"""The sections of the report, one per file, with a TITLE and `context(record)`, which returns the template's values.

The template of `sections/NAME.py` is `templates/sections/NAME.html.j2`. A section is added by writing the two files and
naming it here. `context` returns None if there is nothing to show. An interactive section names its SCRIPTS and STYLES,
files of templates/, which are left out if the values have a true `still`.
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
PICTURES_COMPARE = ("headline", "pictures", "provenance")
CONTACT_COMPARE = ("headline", "wrench", "where_it_fails", "pictures", "provenance")
CHANNELS = ("headline", "channels", "found", "next_experiment")  # with several channels; each channel's sections follow
SHARED = ("headline", "found", "next_experiment", "provenance")  # shown once, not for each of several channels
