"""The status text says first what matters."""

from dataclasses import replace

import numpy as np

from pipeline.messages import NodeStatus, QualityWarning
from pipeline.viewer.pictures.status_text import (
    SessionStatus,
    count_noun,
    frequencies_text,
    posterior_text,
)
from tests.pipeline.viewer.session import (
    TURBINE,
    Episode,
    foundation_posterior,
    modal_estimate,
    node_status,
    rejection,
    session,
)


def test_before_the_first_window_there_is_no_claim():
    assert "No posterior yet" in SessionStatus(TURBINE).markdown()


def test_a_spring_with_a_wide_interval_is_known_roughly():
    rng = np.random.default_rng(8)
    posterior = foundation_posterior(modal_estimate(0, rng), 6, rng)
    k22 = posterior.parameter("k22")
    wide = replace(k22, p05=0.7 * k22.median, p95=1.4 * k22.median)
    parameters = tuple(wide if each.name == "k22" else each for each in posterior.parameters)
    for shown, word in (
        (posterior, "known"),
        (replace(posterior, parameters=parameters), "known roughly"),
    ):
        status = SessionStatus(TURBINE)
        status.take(shown)
        assert status.indicators[-1].text == f"foundation: {word}"
        assert f"**Foundation {word}: " in status.markdown()


def test_the_verdict_comes_before_the_details():
    status = SessionStatus(TURBINE, title="A turbine")
    for message in session(Episode(rejected=(1,), block=60)):
        if not isinstance(message, NodeStatus):
            status.take(message)
    text = status.markdown()
    assert text.startswith("### A turbine (iea15mw)\n\n**Foundation known")
    assert text.index("Foundation known") < text.index("| k11 |") < text.index("#### Warnings")


def test_an_untrusted_posterior_is_never_called_known():
    rng = np.random.default_rng(1)
    status = SessionStatus(TURBINE)
    status.take(foundation_posterior(modal_estimate(0, rng), 1, rng, trusted=False))
    text = status.markdown()
    assert "NOT TRUSTED" in text
    assert "known" not in text


def test_only_the_newest_rejections_are_listed_but_all_are_counted():
    status = SessionStatus(TURBINE)
    for window in range(1000):
        status.take(rejection(window))
    text = status.health_markdown()
    assert "1000 rejected, or identified and not used: 1000 × gap; the last 5:" in text
    assert text.count("gap of 60.0 s") == 5


def test_a_window_in_which_the_session_ended_is_no_trouble():
    status = SessionStatus(TURBINE)
    status.take(modal_estimate(0, np.random.default_rng(1)))
    before = status.indicators
    status.take(replace(rejection(1), code="short"))
    assert status.indicators == before
    status.take(rejection(2))
    assert status.indicators[1].state == "bad"


def test_a_node_is_news_when_its_state_or_its_losses_change():
    status = SessionStatus(TURBINE)
    assert status.take_node(node_status("running", 1))
    assert not status.take_node(node_status("running", 2))
    assert status.take_node(node_status("stopped", 3))


def test_warnings_of_a_node_are_below_the_nodes_and_their_text_is_no_markup():
    status = SessionStatus(TURBINE)
    status.take_node(node_status("running", 1))
    doubting = replace(
        node_status("running", 2),
        warnings=(QualityWarning("link-down", "udp: ![x](http://y/`z`)"),),
    )
    assert status.take_node(doubting)
    assert not status.take_node(replace(doubting, last_sequence=3))
    assert "- identification: `udp: ![x](http://y/´z´)`" in status.health_markdown()


def test_one_line_for_a_posterior_has_medians_and_half_widths():
    rng = np.random.default_rng(1)
    text = posterior_text(foundation_posterior(modal_estimate(0, rng), 1, rng))
    assert text.startswith("k ÷ nominal: 1.1")
    assert text.count(" ± ") == 3
    assert len(text) < 60


def test_nouns_are_in_the_plural_after_numbers_other_than_one():
    assert [count_noun(n, "gap") for n in (0, 1, 2)] == ["0 gaps", "1 gap", "2 gaps"]
    assert frequencies_text([]) == "no modes"
    assert frequencies_text([0.158]) == "1 mode, 0.158 Hz"
    assert frequencies_text([0.158, 1.1]) == "2 modes, 0.158 to 1.10 Hz"


def test_indicators_give_each_state_by_colour_and_text():
    status = SessionStatus("t")
    assert {indicator.state for indicator in status.indicators} == {"unknown"}
    messages = list(session(Episode(n_windows=2, rejected=(1,), trusted=False)))
    for message in messages:
        status.take(message)
    measurements, modes, foundation = status.indicators
    assert (measurements.state, modes.state, foundation.state) == ("warning", "bad", "bad")
    assert "1 gap" in measurements.text
    assert "NOT TRUSTED" in foundation.text
