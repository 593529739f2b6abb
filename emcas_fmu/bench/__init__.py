"""The test bench of every study: subject, excitations, figures, verdicts, and writers of results.

    subject.py             the subject: an actuator that can be run; a parameter set as one
    fmu_subject.py         an FMU as the subject, and how a subject of either kind is opened
    fmu.py, fmi3.py        an opened FMU and its model; FMI 3.0 with the calls of FMI 2.0
    references.py          the references embedded in an FMU
    runs.py                responses of one run and of many
    excitation.py          excitations: rows of inputs
    metrics.py             the figures of a response, SI, each defined once
    frequency_response.py  the figures of sweeps and sines
    measure.py             the tests that requirements name, and the figures measured in them
    linear/                the actuator linearised: responses, margins (extra `analysis`)
    requirements.py        figures of tests with limits, read from TOML
    verdict.py             requirements judged
    writers.py             JSON, JUnit and tables for the terminal
    conditions.py          conditions of a simulation, and parameters that are estimates
"""
