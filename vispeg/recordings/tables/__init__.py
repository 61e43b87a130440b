"""Tables of numbers: text read block by block, Parquet, and one reader of both."""
