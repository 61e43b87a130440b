"""Which effects are fitted and accepted: search, judging on held-out blocks, deletion."""
