"""What bounds a hierarchy, for all that read one."""

cpdef enum:
    MOST_LEVELS = 8  # of a stream; each takes a read buffer while a scene is rendered
