"""What acts on a simulated tower, how it changes with time, and on which springs it stands."""

import numpy as np

from sensors.loads import Load, Sea, SeaState, Wind, random_loads, rotor_load, wave_load, wind_load
from sensors.simulation.schedule import Schedule
from sensors.simulation.settings import SimulationError, SimulationSettings
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import FoundationSprings, positive_definite
from sensors.structure.structural_model import StructuralModel


def build_schedule(settings: SimulationSettings, description: TurbineDescription) -> Schedule:
    """Return what of a simulation depends on time alone."""
    water, sea, wind = description.water, settings.sea, settings.wind
    return Schedule(
        stages=settings.stages,
        foundation=settings.foundation,
        tide=settings.tide,
        mean_level=0.0 if water is None else water.level,
        wind_speed=wind.speed if wind else Wind().speed,
        significant_wave_height=sea.significant_wave_height if sea else 0.0,
        peak_period=sea.peak_period if sea else Sea().peak_period,
    )


def build_loads(
    model: StructuralModel, settings: SimulationSettings, schedule: Schedule, rate: float
) -> tuple[Load, ...]:
    """Return every load of a simulation as series at the integration's rate.

    Parameters
    ----------
    model : StructuralModel
        That the loads act on.
    settings : SimulationSettings
        Which loads there are.
    schedule : Schedule
        Wind, sea and rotor over time.
    rate : float
        Of the integration [Hz].

    Raises
    ------
    SimulationError
        If there is none.
    """
    loads: list[Load] = list(
        random_loads(model, broadband=settings.broadband, waves=settings.waves, sampling_rate=rate)
    )
    begin = {"sampling_rate": rate, "start": -settings.transient}

    def wind_speed(time: float) -> float:
        return schedule.figure("wind_speed", time)

    def sea_state(time: float) -> SeaState:
        assert settings.sea is not None
        return SeaState(
            significant_wave_height=schedule.figure("significant_wave_height", time),
            peak_period=schedule.figure("peak_period", time),
            level=schedule.level(time),
            direction=settings.sea.direction - schedule.figure("yaw", time),
        )

    if settings.sea is not None:
        levels = {
            "highest_level": schedule.highest_level,
            "largest_height": schedule.largest("significant_wave_height"),
        }
        loads.append(wave_load(model, settings.sea, sea_state, **levels, **begin))
    if settings.wind is not None:
        loads.append(wind_load(model, settings.wind, wind_speed, **begin))
        if schedule.turns:
            loads.append(
                rotor_load(
                    model,
                    settings.rotor,
                    settings.wind,
                    steady_at=schedule.rotor,
                    speed_at=wind_speed,
                    **begin,
                )
            )
    if not loads:
        raise SimulationError(
            "every load is 0 N; at least one of broadband tower_rms, blade_rms, waves "
            "fore_aft_rms, side_side_rms must be positive, or [simulation.wind] or "
            "[simulation.sea] be there"
        )
    return tuple(loads)


def true_springs(
    description: TurbineDescription, ratios: tuple[float, float, float]
) -> FoundationSprings:
    """Return the description's springs times the ratios of k11, k22, k12.

    Parameters
    ----------
    description : TurbineDescription
        With the nominal springs and the sign of k12.
    ratios : tuple of float
        True over nominal k11, k22, k12 [-].

    Raises
    ------
    SimulationError
        If the product is not positive definite.
    """
    k11, k22, k12 = (description.nominal * np.array(ratios)).tolist()
    if not bool(positive_definite((k11, k22, k12))):
        raise SimulationError(
            f"stiffness_ratios {', '.join(f'{ratio:g}' for ratio in ratios)} of {description.name} "
            "are not positive definite; k11, k22 > 0 and k12 < sqrt(k11·k22) are needed"
        )
    return FoundationSprings(k11, k22, k12, sign=description.foundation.sign)
