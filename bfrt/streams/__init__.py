"""Files of records, written once and read forwards, and queues that outgrow memory.

::

    records ─► FileWriter ─► file ─► SharedFile ─► Reader ─► records   in order, forwards only
    records ─► Spool: memory, then a file without a name ─► records    first in, first out
                 └── bucket_sort ─► spools by ranges of a number
    content ─► atomic_path: a temporary file ─► the file's name        whole or not at all
                 └── ownership: its name and its lock ─► litter: what no process owns any more

All raise `StreamError` with file and offset for what the system refuses, and count bytes and seeks.
"""
