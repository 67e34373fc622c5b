"""Libraries that read in a process of their own: what is broken in a file may end that one alone.

::

    process: RemoteFile ══ messages ══► serving ─► the library
                  ◄═══ rows, raw bytes ═══

A library in C ends the process, goes round for ever, takes more memory than there is, or writes
where it may not, at some files that are damaged. The system ends a child that has had the processor
for minutes for one answer. The child has no more to do than `messages` can ask for, and ends when
its pipe is closed.
"""
