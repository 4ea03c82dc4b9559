"""Words of a run's figures."""

from pipeline.state.phrases import figure_name, figures_named


def test_figures_of_a_warning_go_by_their_names_in_the_tables() -> None:
    text = "rna_mass lies below the description, 10.1 times as far as its prior lets it be moved"
    assert figures_named(text).startswith("RNA mass lies below ")
    assert figures_named("wall_thickness lies 4.5 above").startswith(figure_name("wall_thickness"))


def test_names_of_channels_and_options_stay_as_they_are() -> None:
    for text in ("z41_fa is constant", "give [oma] window_duration", "gain z80-fa lies 4.2 above"):
        assert figures_named(text) == text
