"""Other people's files: one reader a format, all streaming."""
