"""What bench/report.py is made of.

::

    cases.py     what is run, at which size      kinds.py     what a row of each table holds
    flat.py      a script's JSON as rows         record.py    the JSON of one version, case by case
    machine.py   versions, probes of the hour    running.py   the cases that are not there yet
    parts.py     what an answer is made of
    tables.py    rows as reStructuredText        plots.py     rows as pictures
    sections.py  the page's questions            speed.py, beside.py, costs.py   their answers
    summary.py   ten lines                       page.py      the files that the page includes
    history.py   numbers from version to version
"""
