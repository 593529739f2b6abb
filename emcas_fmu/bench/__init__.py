"""The test bench of every study: subject, excitations, metrics, verdicts, and ways to write results.

    subject.py      an actuator behind one way to run it; a parameter set of any
    fmu_subject.py  the same of an FMU, and opening either kind
    runs.py         responses, of one run and of many
    excitation.py   what is done to it: rows of inputs
    metrics.py      the figures of a response, SI, each defined once
    frequency_response.py  the figures of sweeps and sines
    linear/         the actuator linearised: responses, margins (extra `analysis`)
    verdict.py      figures against requirements
    writers.py      JSON, JUnit and pages of the blocks in macros.html.j2 over base.html.j2; curves.js draws with uPlot
    provenance.py   how a result came about: command, files, hashes, date; conditions
    fmu.py          opening an FMU and telling its model
"""
