"""What bench/report.py is made of.

::

    cases.py     what is run, at which size      kinds.py     what a row of each table holds
    flat.py      a script's JSON as rows         record.py    the JSON of one version, case by case
    machine.py   versions, probes of the hour    running.py   the cases that are not there yet
    tables.py    rows as reStructuredText        plots.py     rows as pictures
    sections.py  questions and their answers     page.py      the files that the page includes
    history.py   numbers from version to version
"""
