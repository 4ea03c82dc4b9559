"""The tab "Foundation": the springs' posterior, what it is worth, and how it changes."""

import rerun.blueprint as rrb

from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import parameter_path
from pipeline.viewer.tabs.narrow import alone, in_tabs, titled
from pipeline.viewer.view_parameters import ViewParameters, plane, time_series


def foundation(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    """Return the tab for a wide screen."""
    return rrb.Horizontal(
        joint_view(root, parameters),
        rrb.Vertical(pile_view(root, parameters), widths_view(root), row_shares=[5, 2]),
        rrb.Vertical(
            *stiffness_views(root, parameters),
            sigma_view(root),
            change_probability_view(root),
            *size_views(root, parameters),
        ),
        column_shares=[5, 4, 4],
        name="Foundation",
    )


def narrow_foundation(root: str, parameters: ViewParameters) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    sizes = "Change [%]: k11 blue, k22 orange, k12 green"
    return in_tabs(
        "Foundation",
        rrb.Vertical(*stiffness_views(root, parameters), widths_view(root), name="Stiffness"),
        alone(
            "Joint",
            joint_view(root, parameters),
            f"Stiffness ÷ nominal [-]; prior orange{parameters.truth}",
        ),
        alone("Springs", pile_view(root, parameters)),
        rrb.Vertical(
            sigma_view(root),
            change_probability_view(root),
            *[titled(size, sizes) for size in size_views(root, parameters)],
            name="Changes",
        ),
    )


def stiffness_views(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    """Return a plot of each stiffness."""
    return [
        time_series(
            parameter_path(root, name),
            f"{name} ÷ nominal [-]: 5, 50, 95 % quantiles{parameters.truth}",
        )
        for name in STIFFNESSES
    ]


def joint_view(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    """Return the corner plot of the stiffnesses."""
    return plane(
        f"{root}/foundation/joint",
        f"Joint posterior of stiffness ÷ nominal [-]; prior orange{parameters.truth}",
        [-0.4, 4.15],
        [-0.5, 4.25],
    )


def pile_view(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    """Return the tower on its springs."""
    return plane(
        f"{root}/foundation/pile",
        f"Under 1 MN: nominal orange, posterior purple{parameters.truth}",
        [-1.35, 1.35],
        [-2.25, 1.25],
    )


def widths_view(root: str) -> rrb.TimeSeriesView:
    """Return what is left of each parameter's prior width."""
    return time_series(
        f"{root}/posterior_width", "Posterior width ÷ prior width [%], 90 % intervals", "LeftTop"
    )


def sigma_view(root: str) -> rrb.TimeSeriesView:
    """Return the band of the model's discrepancy."""
    return time_series(
        parameter_path(root, "sigma"), "Model discrepancy σ [-]: 5, 50, 95 % quantiles"
    )


def change_probability_view(root: str) -> rrb.TimeSeriesView:
    """Return the probability of a change, over time."""
    return time_series(
        f"{root}/change",
        "Probability of a new change [-]; red: detected",
        contents=["$origin/probability", "$origin/noticed"],
        axis_y=rrb.ScalarAxis(range=(-0.1, 1.1)),  # 0 and 1 are most of what is seen
    )


def size_views(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    """Return the plot that appears with the first change of known size."""
    text = "Change of stiffness [%], 5, 50, 95 %: k11 blue, k22 orange, k12 green"
    return [time_series(f"{root}/change/size", text)] * parameters.sized  # a legend would hide it
