"""From other people's files to a recording; one format a file."""
