"""Pages of studies and FMUs, and tables on the terminal.

    page.py        a page from a template: numbered figures and tables, contents
    base.html.j2   what every page has; macros.html.j2, the blocks it is made of
    numbers.py     figures and units as people read them
    terminal.py    tables on the terminal
    provenance.py  how a page was made: command, files, hashes, date
    credibility.py what is known of a model, and what was not done: the card of an FMU and of a report
    curves.js      draws the curves of a figure with uPlot; draw.js, what it shares with the explorer
"""
