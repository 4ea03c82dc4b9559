"""The one error that a person can cause and correct.

InputError                 what was given is wrong
├── TurbineError           a turbine description (sensors.structure.description)
├── LayoutError            a sensor layout (sensors.acquisition.layout)
├── LoadError              a load on the structure (sensors.loads)
├── SimulationError        how a tower is simulated (sensors.simulation.settings)
├── ScenarioError          a scenario file (pipeline.scenario)
├── RecordingError         a recording that is missing, foreign or damaged (pipeline.recording)
└── TransportError         a port in use, an endpoint out of reach (pipeline.transport)
"""


class InputError(ValueError):
    """Something a person gave is wrong.

    The message is one line: the value, where it came from, and what would be right. The command
    line prints it as it stands and exits with code 2; any other exception is a bug.
    """
