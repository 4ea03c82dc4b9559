"""Section [updating] of a scenario: all settings of the updating."""

from dataclasses import dataclass, field

from pipeline.updating.acceptance import AcceptanceSettings
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.prior import PriorSettings
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.registry import SamplingSettings
from pipeline.updating.structural.settings import StructureSettings
from sensors.settings import NEVER_A_KEY


@dataclass(frozen=True, slots=True)
class UpdatingSettings:
    """Section [updating] of a scenario."""

    prior: PriorSettings = field(default_factory=PriorSettings)
    pairing: PairingSettings = field(default_factory=PairingSettings)
    likelihood: LikelihoodSettings = field(default_factory=LikelihoodSettings)
    sampling: SamplingSettings = field(default_factory=SamplingSettings)
    sampler: SamplerSettings = field(default_factory=SamplerSettings)
    """Emcee's."""
    guards: AcceptanceSettings = field(default_factory=AcceptanceSettings)
    change: ChangeSettings = field(default_factory=ChangeSettings)
    structure: StructureSettings = field(default_factory=StructureSettings, metadata=NEVER_A_KEY)
    """Section [structure]."""
    population: str = ""
    """File of a farm's prior, written by `pilewatch farm --prior`; empty: none."""
