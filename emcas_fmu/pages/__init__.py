"""Pages of studies and FMUs, and tables on the terminal.

    page.py        a page from a template: numbered figures and tables, contents
    base.html.j2   the frame of every page; macros.html.j2, the blocks in it
    numbers.py     numbers and units as text
    terminal.py    tables on the terminal
    provenance.py  how a page was made: command, files, hashes, date
    credibility.py the credibility card of an FMU or report: facts about a model, and checks that were not done
    curves.js      plots the curves of a figure with uPlot, by the functions of draw.js, which the explorer also uses
"""
