"""Layouts of other programs: BOP and plain files, written and read."""
