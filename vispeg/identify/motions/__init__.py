"""Commands for an arm, before they are recorded: of a file, of a camera that looks, and tried for speed."""
