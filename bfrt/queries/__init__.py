"""Ray queries: rays that somebody asks about, in place of a camera's."""
