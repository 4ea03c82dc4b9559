from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class FloatMatrix(_message.Message):
    __slots__ = ("rows", "columns", "values")
    ROWS_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    rows: int
    columns: int
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, rows: _Optional[int] = ..., columns: _Optional[int] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class DoubleMatrix(_message.Message):
    __slots__ = ("rows", "columns", "values")
    ROWS_FIELD_NUMBER: _ClassVar[int]
    COLUMNS_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    rows: int
    columns: int
    values: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, rows: _Optional[int] = ..., columns: _Optional[int] = ..., values: _Optional[_Iterable[float]] = ...) -> None: ...

class AccelerationBlock(_message.Message):
    __slots__ = ("turbine", "unit", "session", "layout_id", "sequence", "first_sample", "start_ns", "sampling_rate", "samples", "status")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    LAYOUT_ID_FIELD_NUMBER: _ClassVar[int]
    SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    SAMPLING_RATE_FIELD_NUMBER: _ClassVar[int]
    SAMPLES_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    unit: str
    session: str
    layout_id: str
    sequence: int
    first_sample: int
    start_ns: int
    sampling_rate: float
    samples: FloatMatrix
    status: int
    def __init__(self, turbine: _Optional[str] = ..., unit: _Optional[str] = ..., session: _Optional[str] = ..., layout_id: _Optional[str] = ..., sequence: _Optional[int] = ..., first_sample: _Optional[int] = ..., start_ns: _Optional[int] = ..., sampling_rate: _Optional[float] = ..., samples: _Optional[_Union[FloatMatrix, _Mapping]] = ..., status: _Optional[int] = ...) -> None: ...

class Accelerometer(_message.Message):
    __slots__ = ("name", "elevation", "direction", "coupling", "corner_frequency", "serial", "unit")
    NAME_FIELD_NUMBER: _ClassVar[int]
    ELEVATION_FIELD_NUMBER: _ClassVar[int]
    DIRECTION_FIELD_NUMBER: _ClassVar[int]
    COUPLING_FIELD_NUMBER: _ClassVar[int]
    CORNER_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    SERIAL_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    name: str
    elevation: float
    direction: _containers.RepeatedScalarFieldContainer[float]
    coupling: str
    corner_frequency: float
    serial: str
    unit: str
    def __init__(self, name: _Optional[str] = ..., elevation: _Optional[float] = ..., direction: _Optional[_Iterable[float]] = ..., coupling: _Optional[str] = ..., corner_frequency: _Optional[float] = ..., serial: _Optional[str] = ..., unit: _Optional[str] = ...) -> None: ...

class SensorLayout(_message.Message):
    __slots__ = ("layout_id", "turbine", "unit", "channels")
    LAYOUT_ID_FIELD_NUMBER: _ClassVar[int]
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    layout_id: str
    turbine: str
    unit: str
    channels: _containers.RepeatedCompositeFieldContainer[Accelerometer]
    def __init__(self, layout_id: _Optional[str] = ..., turbine: _Optional[str] = ..., unit: _Optional[str] = ..., channels: _Optional[_Iterable[_Union[Accelerometer, _Mapping]]] = ...) -> None: ...

class StreamGap(_message.Message):
    __slots__ = ("turbine", "unit", "session", "start_ns", "end_ns", "first_sequence", "n_blocks")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    END_NS_FIELD_NUMBER: _ClassVar[int]
    FIRST_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    N_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    unit: str
    session: str
    start_ns: int
    end_ns: int
    first_sequence: int
    n_blocks: int
    def __init__(self, turbine: _Optional[str] = ..., unit: _Optional[str] = ..., session: _Optional[str] = ..., start_ns: _Optional[int] = ..., end_ns: _Optional[int] = ..., first_sequence: _Optional[int] = ..., n_blocks: _Optional[int] = ...) -> None: ...

class StreamEnd(_message.Message):
    __slots__ = ("turbine", "unit", "session", "time_ns", "n_blocks")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    N_BLOCKS_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    unit: str
    session: str
    time_ns: int
    n_blocks: int
    def __init__(self, turbine: _Optional[str] = ..., unit: _Optional[str] = ..., session: _Optional[str] = ..., time_ns: _Optional[int] = ..., n_blocks: _Optional[int] = ...) -> None: ...

class BlockRange(_message.Message):
    __slots__ = ("first", "end", "earliest_ns", "latest_ns")
    FIRST_FIELD_NUMBER: _ClassVar[int]
    END_FIELD_NUMBER: _ClassVar[int]
    EARLIEST_NS_FIELD_NUMBER: _ClassVar[int]
    LATEST_NS_FIELD_NUMBER: _ClassVar[int]
    first: int
    end: int
    earliest_ns: int
    latest_ns: int
    def __init__(self, first: _Optional[int] = ..., end: _Optional[int] = ..., earliest_ns: _Optional[int] = ..., latest_ns: _Optional[int] = ...) -> None: ...

class RecordedUntil(_message.Message):
    __slots__ = ("turbine", "unit", "session", "time_ns", "ranges")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    RANGES_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    unit: str
    session: str
    time_ns: int
    ranges: _containers.RepeatedCompositeFieldContainer[BlockRange]
    def __init__(self, turbine: _Optional[str] = ..., unit: _Optional[str] = ..., session: _Optional[str] = ..., time_ns: _Optional[int] = ..., ranges: _Optional[_Iterable[_Union[BlockRange, _Mapping]]] = ...) -> None: ...

class FoundationTruth(_message.Message):
    __slots__ = ("turbine", "time_ns", "k11", "k22", "k12")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    K11_FIELD_NUMBER: _ClassVar[int]
    K22_FIELD_NUMBER: _ClassVar[int]
    K12_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    time_ns: int
    k11: float
    k22: float
    k12: float
    def __init__(self, turbine: _Optional[str] = ..., time_ns: _Optional[int] = ..., k11: _Optional[float] = ..., k22: _Optional[float] = ..., k12: _Optional[float] = ...) -> None: ...

class ScadaSample(_message.Message):
    __slots__ = ("turbine", "time_ns", "state", "wind_speed", "rotor_speed", "pitch", "yaw", "power", "water_level")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    WIND_SPEED_FIELD_NUMBER: _ClassVar[int]
    ROTOR_SPEED_FIELD_NUMBER: _ClassVar[int]
    PITCH_FIELD_NUMBER: _ClassVar[int]
    YAW_FIELD_NUMBER: _ClassVar[int]
    POWER_FIELD_NUMBER: _ClassVar[int]
    WATER_LEVEL_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    time_ns: int
    state: str
    wind_speed: float
    rotor_speed: float
    pitch: float
    yaw: float
    power: float
    water_level: float
    def __init__(self, turbine: _Optional[str] = ..., time_ns: _Optional[int] = ..., state: _Optional[str] = ..., wind_speed: _Optional[float] = ..., rotor_speed: _Optional[float] = ..., pitch: _Optional[float] = ..., yaw: _Optional[float] = ..., power: _Optional[float] = ..., water_level: _Optional[float] = ...) -> None: ...

class Warning(_message.Message):
    __slots__ = ("code", "text")
    CODE_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    code: str
    text: str
    def __init__(self, code: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...

class Mode(_message.Message):
    __slots__ = ("name", "frequency", "frequency_std", "damping_ratio", "damping_ratio_std", "shape", "covariance_factor", "n_block_columns", "phase_collinearity", "presence", "quality", "pair_id")
    NAME_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_STD_FIELD_NUMBER: _ClassVar[int]
    DAMPING_RATIO_FIELD_NUMBER: _ClassVar[int]
    DAMPING_RATIO_STD_FIELD_NUMBER: _ClassVar[int]
    SHAPE_FIELD_NUMBER: _ClassVar[int]
    COVARIANCE_FACTOR_FIELD_NUMBER: _ClassVar[int]
    N_BLOCK_COLUMNS_FIELD_NUMBER: _ClassVar[int]
    PHASE_COLLINEARITY_FIELD_NUMBER: _ClassVar[int]
    PRESENCE_FIELD_NUMBER: _ClassVar[int]
    QUALITY_FIELD_NUMBER: _ClassVar[int]
    PAIR_ID_FIELD_NUMBER: _ClassVar[int]
    name: str
    frequency: float
    frequency_std: float
    damping_ratio: float
    damping_ratio_std: float
    shape: _containers.RepeatedScalarFieldContainer[float]
    covariance_factor: DoubleMatrix
    n_block_columns: int
    phase_collinearity: float
    presence: float
    quality: float
    pair_id: str
    def __init__(self, name: _Optional[str] = ..., frequency: _Optional[float] = ..., frequency_std: _Optional[float] = ..., damping_ratio: _Optional[float] = ..., damping_ratio_std: _Optional[float] = ..., shape: _Optional[_Iterable[float]] = ..., covariance_factor: _Optional[_Union[DoubleMatrix, _Mapping]] = ..., n_block_columns: _Optional[int] = ..., phase_collinearity: _Optional[float] = ..., presence: _Optional[float] = ..., quality: _Optional[float] = ..., pair_id: _Optional[str] = ...) -> None: ...

class UnitOrigin(_message.Message):
    __slots__ = ("unit", "session", "boot", "first_sample")
    UNIT_FIELD_NUMBER: _ClassVar[int]
    SESSION_FIELD_NUMBER: _ClassVar[int]
    BOOT_FIELD_NUMBER: _ClassVar[int]
    FIRST_SAMPLE_FIELD_NUMBER: _ClassVar[int]
    unit: str
    session: str
    boot: int
    first_sample: int
    def __init__(self, unit: _Optional[str] = ..., session: _Optional[str] = ..., boot: _Optional[int] = ..., first_sample: _Optional[int] = ...) -> None: ...

class ModalEstimate(_message.Message):
    __slots__ = ("turbine", "window", "start_ns", "end_ns", "layout_id", "channels", "modes", "weight", "warnings", "operating_state", "wind_speed", "rotor_speed", "yaw", "water_level", "origins")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    END_NS_FIELD_NUMBER: _ClassVar[int]
    LAYOUT_ID_FIELD_NUMBER: _ClassVar[int]
    CHANNELS_FIELD_NUMBER: _ClassVar[int]
    MODES_FIELD_NUMBER: _ClassVar[int]
    WEIGHT_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    OPERATING_STATE_FIELD_NUMBER: _ClassVar[int]
    WIND_SPEED_FIELD_NUMBER: _ClassVar[int]
    ROTOR_SPEED_FIELD_NUMBER: _ClassVar[int]
    YAW_FIELD_NUMBER: _ClassVar[int]
    WATER_LEVEL_FIELD_NUMBER: _ClassVar[int]
    ORIGINS_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    window: int
    start_ns: int
    end_ns: int
    layout_id: str
    channels: _containers.RepeatedScalarFieldContainer[str]
    modes: _containers.RepeatedCompositeFieldContainer[Mode]
    weight: float
    warnings: _containers.RepeatedCompositeFieldContainer[Warning]
    operating_state: str
    wind_speed: float
    rotor_speed: float
    yaw: float
    water_level: float
    origins: _containers.RepeatedCompositeFieldContainer[UnitOrigin]
    def __init__(self, turbine: _Optional[str] = ..., window: _Optional[int] = ..., start_ns: _Optional[int] = ..., end_ns: _Optional[int] = ..., layout_id: _Optional[str] = ..., channels: _Optional[_Iterable[str]] = ..., modes: _Optional[_Iterable[_Union[Mode, _Mapping]]] = ..., weight: _Optional[float] = ..., warnings: _Optional[_Iterable[_Union[Warning, _Mapping]]] = ..., operating_state: _Optional[str] = ..., wind_speed: _Optional[float] = ..., rotor_speed: _Optional[float] = ..., yaw: _Optional[float] = ..., water_level: _Optional[float] = ..., origins: _Optional[_Iterable[_Union[UnitOrigin, _Mapping]]] = ...) -> None: ...

class RefusedMode(_message.Message):
    __slots__ = ("frequency", "damping_ratio", "code", "text")
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    DAMPING_RATIO_FIELD_NUMBER: _ClassVar[int]
    CODE_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    frequency: float
    damping_ratio: float
    code: str
    text: str
    def __init__(self, frequency: _Optional[float] = ..., damping_ratio: _Optional[float] = ..., code: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...

class StabilisationDiagram(_message.Message):
    __slots__ = ("turbine", "window", "start_ns", "end_ns", "orders", "bands", "frequencies", "frequency_stds", "damping_ratios", "refused")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    END_NS_FIELD_NUMBER: _ClassVar[int]
    ORDERS_FIELD_NUMBER: _ClassVar[int]
    BANDS_FIELD_NUMBER: _ClassVar[int]
    FREQUENCIES_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_STDS_FIELD_NUMBER: _ClassVar[int]
    DAMPING_RATIOS_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    window: int
    start_ns: int
    end_ns: int
    orders: _containers.RepeatedScalarFieldContainer[float]
    bands: _containers.RepeatedScalarFieldContainer[float]
    frequencies: _containers.RepeatedScalarFieldContainer[float]
    frequency_stds: _containers.RepeatedScalarFieldContainer[float]
    damping_ratios: _containers.RepeatedScalarFieldContainer[float]
    refused: _containers.RepeatedCompositeFieldContainer[RefusedMode]
    def __init__(self, turbine: _Optional[str] = ..., window: _Optional[int] = ..., start_ns: _Optional[int] = ..., end_ns: _Optional[int] = ..., orders: _Optional[_Iterable[float]] = ..., bands: _Optional[_Iterable[float]] = ..., frequencies: _Optional[_Iterable[float]] = ..., frequency_stds: _Optional[_Iterable[float]] = ..., damping_ratios: _Optional[_Iterable[float]] = ..., refused: _Optional[_Iterable[_Union[RefusedMode, _Mapping]]] = ...) -> None: ...

class WindowRejected(_message.Message):
    __slots__ = ("turbine", "window", "start_ns", "end_ns", "code", "reason", "origins", "windows_before")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    START_NS_FIELD_NUMBER: _ClassVar[int]
    END_NS_FIELD_NUMBER: _ClassVar[int]
    CODE_FIELD_NUMBER: _ClassVar[int]
    REASON_FIELD_NUMBER: _ClassVar[int]
    ORIGINS_FIELD_NUMBER: _ClassVar[int]
    WINDOWS_BEFORE_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    window: int
    start_ns: int
    end_ns: int
    code: str
    reason: str
    origins: _containers.RepeatedCompositeFieldContainer[UnitOrigin]
    windows_before: int
    def __init__(self, turbine: _Optional[str] = ..., window: _Optional[int] = ..., start_ns: _Optional[int] = ..., end_ns: _Optional[int] = ..., code: _Optional[str] = ..., reason: _Optional[str] = ..., origins: _Optional[_Iterable[_Union[UnitOrigin, _Mapping]]] = ..., windows_before: _Optional[int] = ...) -> None: ...

class ParameterSummary(_message.Message):
    __slots__ = ("name", "unit", "nominal", "median", "p05", "p95", "contraction")
    NAME_FIELD_NUMBER: _ClassVar[int]
    UNIT_FIELD_NUMBER: _ClassVar[int]
    NOMINAL_FIELD_NUMBER: _ClassVar[int]
    MEDIAN_FIELD_NUMBER: _ClassVar[int]
    P05_FIELD_NUMBER: _ClassVar[int]
    P95_FIELD_NUMBER: _ClassVar[int]
    CONTRACTION_FIELD_NUMBER: _ClassVar[int]
    name: str
    unit: str
    nominal: float
    median: float
    p05: float
    p95: float
    contraction: float
    def __init__(self, name: _Optional[str] = ..., unit: _Optional[str] = ..., nominal: _Optional[float] = ..., median: _Optional[float] = ..., p05: _Optional[float] = ..., p95: _Optional[float] = ..., contraction: _Optional[float] = ...) -> None: ...

class ModePair(_message.Message):
    __slots__ = ("identified", "model", "frequency", "frequency_std", "model_frequency", "mac", "shape_used", "misfit", "information")
    IDENTIFIED_FIELD_NUMBER: _ClassVar[int]
    MODEL_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_STD_FIELD_NUMBER: _ClassVar[int]
    MODEL_FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    MAC_FIELD_NUMBER: _ClassVar[int]
    SHAPE_USED_FIELD_NUMBER: _ClassVar[int]
    MISFIT_FIELD_NUMBER: _ClassVar[int]
    INFORMATION_FIELD_NUMBER: _ClassVar[int]
    identified: str
    model: str
    frequency: float
    frequency_std: float
    model_frequency: float
    mac: float
    shape_used: bool
    misfit: float
    information: float
    def __init__(self, identified: _Optional[str] = ..., model: _Optional[str] = ..., frequency: _Optional[float] = ..., frequency_std: _Optional[float] = ..., model_frequency: _Optional[float] = ..., mac: _Optional[float] = ..., shape_used: bool = ..., misfit: _Optional[float] = ..., information: _Optional[float] = ...) -> None: ...

class FoundationPosterior(_message.Message):
    __slots__ = ("turbine", "window", "time_ns", "n_windows", "parameters", "correlation", "draws", "pairs", "model_labels", "model_frequencies", "model_shapes", "sampler", "ess", "rhat", "autocorrelation_time", "reduced_chi_square", "paired_share", "pairing_cost", "trusted", "warnings", "population", "figures", "change_probability", "structure", "budget", "alternatives", "unpredicted_share", "relative", "figure_errors", "origins")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    N_WINDOWS_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    CORRELATION_FIELD_NUMBER: _ClassVar[int]
    DRAWS_FIELD_NUMBER: _ClassVar[int]
    PAIRS_FIELD_NUMBER: _ClassVar[int]
    MODEL_LABELS_FIELD_NUMBER: _ClassVar[int]
    MODEL_FREQUENCIES_FIELD_NUMBER: _ClassVar[int]
    MODEL_SHAPES_FIELD_NUMBER: _ClassVar[int]
    SAMPLER_FIELD_NUMBER: _ClassVar[int]
    ESS_FIELD_NUMBER: _ClassVar[int]
    RHAT_FIELD_NUMBER: _ClassVar[int]
    AUTOCORRELATION_TIME_FIELD_NUMBER: _ClassVar[int]
    REDUCED_CHI_SQUARE_FIELD_NUMBER: _ClassVar[int]
    PAIRED_SHARE_FIELD_NUMBER: _ClassVar[int]
    PAIRING_COST_FIELD_NUMBER: _ClassVar[int]
    TRUSTED_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    POPULATION_FIELD_NUMBER: _ClassVar[int]
    FIGURES_FIELD_NUMBER: _ClassVar[int]
    CHANGE_PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    STRUCTURE_FIELD_NUMBER: _ClassVar[int]
    BUDGET_FIELD_NUMBER: _ClassVar[int]
    ALTERNATIVES_FIELD_NUMBER: _ClassVar[int]
    UNPREDICTED_SHARE_FIELD_NUMBER: _ClassVar[int]
    RELATIVE_FIELD_NUMBER: _ClassVar[int]
    FIGURE_ERRORS_FIELD_NUMBER: _ClassVar[int]
    ORIGINS_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    window: int
    time_ns: int
    n_windows: int
    parameters: _containers.RepeatedCompositeFieldContainer[ParameterSummary]
    correlation: DoubleMatrix
    draws: DoubleMatrix
    pairs: _containers.RepeatedCompositeFieldContainer[ModePair]
    model_labels: _containers.RepeatedScalarFieldContainer[str]
    model_frequencies: _containers.RepeatedScalarFieldContainer[float]
    model_shapes: DoubleMatrix
    sampler: str
    ess: float
    rhat: float
    autocorrelation_time: float
    reduced_chi_square: float
    paired_share: float
    pairing_cost: float
    trusted: bool
    warnings: _containers.RepeatedCompositeFieldContainer[Warning]
    population: str
    figures: _containers.RepeatedCompositeFieldContainer[ParameterSummary]
    change_probability: float
    structure: str
    budget: _containers.RepeatedCompositeFieldContainer[FigureShare]
    alternatives: _containers.RepeatedCompositeFieldContainer[StructureAlternative]
    unpredicted_share: float
    relative: _containers.RepeatedCompositeFieldContainer[RelativeStiffness]
    figure_errors: _containers.RepeatedCompositeFieldContainer[FigureError]
    origins: _containers.RepeatedCompositeFieldContainer[UnitOrigin]
    def __init__(self, turbine: _Optional[str] = ..., window: _Optional[int] = ..., time_ns: _Optional[int] = ..., n_windows: _Optional[int] = ..., parameters: _Optional[_Iterable[_Union[ParameterSummary, _Mapping]]] = ..., correlation: _Optional[_Union[DoubleMatrix, _Mapping]] = ..., draws: _Optional[_Union[DoubleMatrix, _Mapping]] = ..., pairs: _Optional[_Iterable[_Union[ModePair, _Mapping]]] = ..., model_labels: _Optional[_Iterable[str]] = ..., model_frequencies: _Optional[_Iterable[float]] = ..., model_shapes: _Optional[_Union[DoubleMatrix, _Mapping]] = ..., sampler: _Optional[str] = ..., ess: _Optional[float] = ..., rhat: _Optional[float] = ..., autocorrelation_time: _Optional[float] = ..., reduced_chi_square: _Optional[float] = ..., paired_share: _Optional[float] = ..., pairing_cost: _Optional[float] = ..., trusted: bool = ..., warnings: _Optional[_Iterable[_Union[Warning, _Mapping]]] = ..., population: _Optional[str] = ..., figures: _Optional[_Iterable[_Union[ParameterSummary, _Mapping]]] = ..., change_probability: _Optional[float] = ..., structure: _Optional[str] = ..., budget: _Optional[_Iterable[_Union[FigureShare, _Mapping]]] = ..., alternatives: _Optional[_Iterable[_Union[StructureAlternative, _Mapping]]] = ..., unpredicted_share: _Optional[float] = ..., relative: _Optional[_Iterable[_Union[RelativeStiffness, _Mapping]]] = ..., figure_errors: _Optional[_Iterable[_Union[FigureError, _Mapping]]] = ..., origins: _Optional[_Iterable[_Union[UnitOrigin, _Mapping]]] = ...) -> None: ...

class FigureShare(_message.Message):
    __slots__ = ("name", "k11", "k22", "k12")
    NAME_FIELD_NUMBER: _ClassVar[int]
    K11_FIELD_NUMBER: _ClassVar[int]
    K22_FIELD_NUMBER: _ClassVar[int]
    K12_FIELD_NUMBER: _ClassVar[int]
    name: str
    k11: float
    k22: float
    k12: float
    def __init__(self, name: _Optional[str] = ..., k11: _Optional[float] = ..., k22: _Optional[float] = ..., k12: _Optional[float] = ...) -> None: ...

class FigureError(_message.Message):
    __slots__ = ("name", "k11", "k22", "k12")
    NAME_FIELD_NUMBER: _ClassVar[int]
    K11_FIELD_NUMBER: _ClassVar[int]
    K22_FIELD_NUMBER: _ClassVar[int]
    K12_FIELD_NUMBER: _ClassVar[int]
    name: str
    k11: float
    k22: float
    k12: float
    def __init__(self, name: _Optional[str] = ..., k11: _Optional[float] = ..., k22: _Optional[float] = ..., k12: _Optional[float] = ...) -> None: ...

class StructureAlternative(_message.Message):
    __slots__ = ("name", "probability")
    NAME_FIELD_NUMBER: _ClassVar[int]
    PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    name: str
    probability: float
    def __init__(self, name: _Optional[str] = ..., probability: _Optional[float] = ...) -> None: ...

class RelativeStiffness(_message.Message):
    __slots__ = ("name", "median", "p05", "p95", "reference_ns")
    NAME_FIELD_NUMBER: _ClassVar[int]
    MEDIAN_FIELD_NUMBER: _ClassVar[int]
    P05_FIELD_NUMBER: _ClassVar[int]
    P95_FIELD_NUMBER: _ClassVar[int]
    REFERENCE_NS_FIELD_NUMBER: _ClassVar[int]
    name: str
    median: float
    p05: float
    p95: float
    reference_ns: int
    def __init__(self, name: _Optional[str] = ..., median: _Optional[float] = ..., p05: _Optional[float] = ..., p95: _Optional[float] = ..., reference_ns: _Optional[int] = ...) -> None: ...

class PooledPosterior(_message.Message):
    __slots__ = ("turbine", "window", "time_ns", "n_turbines", "parameters", "outlier_probability", "text")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    N_TURBINES_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    OUTLIER_PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    window: int
    time_ns: int
    n_turbines: int
    parameters: _containers.RepeatedCompositeFieldContainer[ParameterSummary]
    outlier_probability: float
    text: str
    def __init__(self, turbine: _Optional[str] = ..., window: _Optional[int] = ..., time_ns: _Optional[int] = ..., n_turbines: _Optional[int] = ..., parameters: _Optional[_Iterable[_Union[ParameterSummary, _Mapping]]] = ..., outlier_probability: _Optional[float] = ..., text: _Optional[str] = ...) -> None: ...

class StiffnessChange(_message.Message):
    __slots__ = ("name", "median", "p05", "p95", "random_walk", "random_walk_std")
    NAME_FIELD_NUMBER: _ClassVar[int]
    MEDIAN_FIELD_NUMBER: _ClassVar[int]
    P05_FIELD_NUMBER: _ClassVar[int]
    P95_FIELD_NUMBER: _ClassVar[int]
    RANDOM_WALK_FIELD_NUMBER: _ClassVar[int]
    RANDOM_WALK_STD_FIELD_NUMBER: _ClassVar[int]
    name: str
    median: float
    p05: float
    p95: float
    random_walk: float
    random_walk_std: float
    def __init__(self, name: _Optional[str] = ..., median: _Optional[float] = ..., p05: _Optional[float] = ..., p95: _Optional[float] = ..., random_walk: _Optional[float] = ..., random_walk_std: _Optional[float] = ...) -> None: ...

class FrequencyShift(_message.Message):
    __slots__ = ("model", "frequency", "change", "change_std")
    MODEL_FIELD_NUMBER: _ClassVar[int]
    FREQUENCY_FIELD_NUMBER: _ClassVar[int]
    CHANGE_FIELD_NUMBER: _ClassVar[int]
    CHANGE_STD_FIELD_NUMBER: _ClassVar[int]
    model: str
    frequency: float
    change: float
    change_std: float
    def __init__(self, model: _Optional[str] = ..., frequency: _Optional[float] = ..., change: _Optional[float] = ..., change_std: _Optional[float] = ...) -> None: ...

class FoundationEvent(_message.Message):
    __slots__ = ("turbine", "window", "time_ns", "kind", "probability", "since_ns", "since_earliest_ns", "since_latest_ns", "changes", "shifts", "text", "origins")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    WINDOW_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    KIND_FIELD_NUMBER: _ClassVar[int]
    PROBABILITY_FIELD_NUMBER: _ClassVar[int]
    SINCE_NS_FIELD_NUMBER: _ClassVar[int]
    SINCE_EARLIEST_NS_FIELD_NUMBER: _ClassVar[int]
    SINCE_LATEST_NS_FIELD_NUMBER: _ClassVar[int]
    CHANGES_FIELD_NUMBER: _ClassVar[int]
    SHIFTS_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    ORIGINS_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    window: int
    time_ns: int
    kind: str
    probability: float
    since_ns: int
    since_earliest_ns: int
    since_latest_ns: int
    changes: _containers.RepeatedCompositeFieldContainer[StiffnessChange]
    shifts: _containers.RepeatedCompositeFieldContainer[FrequencyShift]
    text: str
    origins: _containers.RepeatedCompositeFieldContainer[UnitOrigin]
    def __init__(self, turbine: _Optional[str] = ..., window: _Optional[int] = ..., time_ns: _Optional[int] = ..., kind: _Optional[str] = ..., probability: _Optional[float] = ..., since_ns: _Optional[int] = ..., since_earliest_ns: _Optional[int] = ..., since_latest_ns: _Optional[int] = ..., changes: _Optional[_Iterable[_Union[StiffnessChange, _Mapping]]] = ..., shifts: _Optional[_Iterable[_Union[FrequencyShift, _Mapping]]] = ..., text: _Optional[str] = ..., origins: _Optional[_Iterable[_Union[UnitOrigin, _Mapping]]] = ...) -> None: ...

class MessageCount(_message.Message):
    __slots__ = ("message", "count")
    MESSAGE_FIELD_NUMBER: _ClassVar[int]
    COUNT_FIELD_NUMBER: _ClassVar[int]
    message: str
    count: int
    def __init__(self, message: _Optional[str] = ..., count: _Optional[int] = ...) -> None: ...

class NodeStatus(_message.Message):
    __slots__ = ("turbine", "node", "time_ns", "state", "last_sequence", "received", "published", "lost", "late", "duplicate", "busy_s", "warnings", "malformed", "recovered", "recorded", "refused")
    TURBINE_FIELD_NUMBER: _ClassVar[int]
    NODE_FIELD_NUMBER: _ClassVar[int]
    TIME_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    LAST_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    RECEIVED_FIELD_NUMBER: _ClassVar[int]
    PUBLISHED_FIELD_NUMBER: _ClassVar[int]
    LOST_FIELD_NUMBER: _ClassVar[int]
    LATE_FIELD_NUMBER: _ClassVar[int]
    DUPLICATE_FIELD_NUMBER: _ClassVar[int]
    BUSY_S_FIELD_NUMBER: _ClassVar[int]
    WARNINGS_FIELD_NUMBER: _ClassVar[int]
    MALFORMED_FIELD_NUMBER: _ClassVar[int]
    RECOVERED_FIELD_NUMBER: _ClassVar[int]
    RECORDED_FIELD_NUMBER: _ClassVar[int]
    REFUSED_FIELD_NUMBER: _ClassVar[int]
    turbine: str
    node: str
    time_ns: int
    state: str
    last_sequence: int
    received: _containers.RepeatedCompositeFieldContainer[MessageCount]
    published: _containers.RepeatedCompositeFieldContainer[MessageCount]
    lost: int
    late: int
    duplicate: int
    busy_s: float
    warnings: _containers.RepeatedCompositeFieldContainer[Warning]
    malformed: int
    recovered: int
    recorded: int
    refused: _containers.RepeatedCompositeFieldContainer[MessageCount]
    def __init__(self, turbine: _Optional[str] = ..., node: _Optional[str] = ..., time_ns: _Optional[int] = ..., state: _Optional[str] = ..., last_sequence: _Optional[int] = ..., received: _Optional[_Iterable[_Union[MessageCount, _Mapping]]] = ..., published: _Optional[_Iterable[_Union[MessageCount, _Mapping]]] = ..., lost: _Optional[int] = ..., late: _Optional[int] = ..., duplicate: _Optional[int] = ..., busy_s: _Optional[float] = ..., warnings: _Optional[_Iterable[_Union[Warning, _Mapping]]] = ..., malformed: _Optional[int] = ..., recovered: _Optional[int] = ..., recorded: _Optional[int] = ..., refused: _Optional[_Iterable[_Union[MessageCount, _Mapping]]] = ...) -> None: ...
