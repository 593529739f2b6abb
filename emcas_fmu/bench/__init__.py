"""The test bench that all studies share: subjects, excitations, figures, verdicts, and writers of results.

    subject.py             subjects: actuators that can be simulated; a parameter set as a subject
    fmu_subject.py         an FMU as a subject; opening of FMUs and parameter sets
    fmu.py, fmi3.py        an opened FMU and its model; FMI 3.0 with the calls of FMI 2.0
    references.py          the references embedded in an FMU
    runs.py                responses of one run and of many
    excitation.py          excitations: rows of inputs
    metrics.py             the figures of a response, each defined once
    frequency_response.py  the measurement of steady sines, and the figures of sweeps
    measure.py             the tests of requirements, and the figures measured in them
    linear/                the linearised actuator: responses, margins (extra `analysis`)
    requirements.py        figures of tests with limits, read from TOML
    verdict.py             verdicts on requirements, also as tables for the terminal
    writers.py             JSON, CSV and JUnit files
    conditions.py          conditions of a simulation, and notes on estimated parameters
"""
