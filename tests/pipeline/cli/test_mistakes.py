"""Typical mistakes, three or more a command: exit code 2, one line, no traceback."""

import os
import shlex
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import typer

from pipeline.cli import app, main
from sensors.structure.description import shipped_text

# command line in the folder that `folder` prepares → words of its one line
MISTAKES: tuple[tuple[str, str], ...] = (
    # run
    ("run --source replay:gone.mcap", "gone.mcap"),
    ("run --source gone.csv", "'gone.csv' is none of"),
    ("run --source replay:text.mcap", "text.mcap"),
    ("run --source replay:noise.csv", "noise.csv"),
    ("run --source simulate:", "which scenario?"),
    ("run --source simulate:parkd", "'parkd' is neither a file nor one of the shipped ones"),
    ("run --source simulate:parked --scenario tide", "name two scenarios"),
    ("run --source simulate:parked --speed 0", "--speed 0"),
    ("run --source simulate:parked --from 10", "--from, --to and --loop are for replay"),
    ("run --source simulate:parked --layout layout.toml", "--layout layout.toml is for a file"),
    ("run --source live --notices gone.toml", "gone.toml"),
    ("run --source simulate:parked --view pink", "pink"),
    ("run --source live --shards -1", "--shards -1 needs --processes"),
    ("run --source simulate:parked --metrics 99999", "--metrics is 99999"),
    ("run --source simulate:parked --metrics -1", "--metrics is -1; a port is 0 (any free one)"),
    (
        "run --source simulate:parked --zenoh-config gone.json5 --lock-step",
        "--lock-step has no transport",
    ),
    ("run --source simulate:parked --zenoh-config gone.json5", "gone.json5"),
    ("run parked.mcap", "parked.mcap"),
    # new
    ("new gone.csv", "gone.csv"),
    ("new nan.csv -o made", "nan.csv: less than 1 s of samples"),
    (
        "new wind.csv -o made",
        "wind.csv: no channel measures a motion of the structure: Wind (the wind)",
    ),
    ("identify wind.csv", "wind.csv"),
    ("new means.csv -o made", "means.csv: a value every 600 s is a mean"),
    ("new no-time.csv -o made", "--sampling-rate"),
    ("new noise.csv -o made --structure gone.toml", "gone.toml"),
    ("new noise.csv -o made --structure iea15mw_monopile", "height and axis"),
    ("new text.mcap -o made", "text.mcap"),
    ("new noise.csv -o made --structure tower.dat", "give --springs k11,k22,k12"),
    ("new noise.csv -o made --structure gone.dat", "gone.dat: no such file"),
    ("new noise.csv -o made --structure tower.dat --springs 1,2", "three numbers"),
    ("new noise.csv -o made --structure tower.dat --springs 1e9,1e11,0", "tower.dat"),
    ("new noise.csv -o made --structure gone.yaml --springs 1e9,1e11,0", "gone.yaml"),
    (
        "new noise.csv -o made --springs 1e9,1e11,0",
        "are for --structure NAME_ElastoDyn.dat",
    ),
    ("new noise.csv -o /proc/made", "-o /proc/made: No such file or directory"),
    (
        "new noise.csv -o made --layout layout.toml --structure low.toml",
        "channel high: elevation 40 m is not on the tower",
    ),
    ("new own.toml -o made", "own.toml holds settings: a layout, a scenario or a description"),
    ("new short.mcap -o made", "short.mcap holds a recording"),
    ("new deck.dat -o made", "deck.dat: line 7 has 9 columns where 6 are expected"),
    ("new noise.csv -o noise.csv", "-o noise.csv is a file; a folder is needed"),
    ("new noise.csv -o made --dates american", "'american' is not one of"),
    ("new noise.csv noise.csv -o made", "noise.csv is named twice"),
    # status
    ("status", "no session"),
    ("status --out gone", "gone"),
    ("status --connect nowhere", "nowhere"),
    ("status --zenoh-config alone.json5", "no session answers at alone.json5"),
    # control
    ("control rewind", "'rewind' is not one of"),
    ("control seek soon", "a valid number is needed"),
    ("control play", "no session"),
    ("control seek", "seek"),
    # show
    ("show gone.mcap", "gone.mcap"),
    ("show gone.rrd", "gone.rrd"),
    ("show text.mcap", "text.mcap"),
    ("show noise.csv", "noise.csv"),
    ("show short.mcap --view pink", "pink"),
    ("show short.mcap -o picture.png", "NAME.rrd"),
    # report
    ("report gone.mcap", "gone.mcap"),
    ("report noise.csv", "noise.csv"),
    ("report short.mcap", "holds measurements but no results"),
    ("report empty", "empty"),
    # audit
    ("audit gone", "gone does not exist; give the folder of a run"),
    ("audit noise.csv", "noise.csv is a file; give the folder of a run (its --out)"),
    ("audit short.mcap", "short.mcap is a file; give the folder of a run (its --out)"),
    ("audit empty", "empty"),
    # simulate
    ("simulate", "simulate needs a scenario and -o FILE.mcap"),
    ("simulate parked", "simulate needs a scenario and -o FILE.mcap"),
    ("simulate parkd -o a.mcap", "'parkd'"),
    ("simulate parked -o short.mcap", "exists already"),
    ("simulate --describe lost-tower.toml", "nosuch.toml"),
    ("simulate --describe lost-farm.toml --json", "nosuch.json"),
    ("simulate parked -o a.mcap --duration -5", "duration"),
    ("simulate parked -o a.mcap --duration 1e15", "at most 3.15576e+09 s"),
    ("simulate parked -o . --duration 5", "cannot record to .: it is a folder"),
    ("simulate parked -o gone/a.mcap --duration 5", "gone"),
    ("simulate modes-only -o a.mcap", "no structural model"),
    # import
    ("import noise.csv", "import needs -o FILE.mcap"),
    ("import gone.csv -o a.mcap", "gone.csv"),
    ("import noise.csv -o a.mcap --layout template.toml", "height"),
    ("import noise.csv -o a.mcap --layout gone.toml", "gone.toml"),
    ("import noise.csv -o a.mcap --layout other.toml", "'tip'"),
    ("import noise.csv -o short.mcap --layout layout.toml", "exists already"),
    ("import noise.csv -o empty --layout layout.toml", "cannot record to empty: it is a folder"),
    (
        "import noise.csv -o a.mcap --layout layout.toml --scenario low-scenario.toml",
        "on the tower",
    ),
    ("import noise.csv -o a.mcap --reader nothing", "nothing"),
    ("import gone.csv --template", "gone.csv"),
    ("import noise.csv -o a.mcap --layout layout.toml --zone Berlin", "zone 'Berlin'"),
    # info
    ("info gone.mcap", "gone.mcap"),
    ("info noise.csv", "noise.csv"),
    ("info empty", "empty"),
    ("info cut.mcap", "cut.mcap was cut off before its end: nothing of it can be salvaged"),
    # salvage
    ("salvage short.mcap -o .", "cannot record to .: it is a folder"),
    ("salvage gone.mcap", "gone.mcap"),
    ("salvage noise.csv", "noise.csv"),
    ("salvage short.mcap -o short.mcap", "short.mcap"),
    # export
    ("export short.mcap", "export needs one of --csv, --parquet and --imu"),
    ("export short.mcap --csv --parquet", "export needs one of --csv, --parquet and --imu"),
    ("export gone.mcap --csv", "gone.mcap"),
    ("export noise.csv --csv", "noise.csv"),
    # identify
    ("identify gone.csv", "gone.csv"),
    ("identify nan.csv", "NaN"),
    ("identify constant.csv", "constant"),
    ("run -q", "-q stands before the command: `pilewatch -q run …`"),
    ("identify brief.csv", "brief.csv"),
    ("identify no-time.csv", "--sampling-rate"),
    ("identify noise.csv --lowest-frequency 30", "30 Hz"),
    ("identify noise.csv --window 0", "--window is 0 s; it must be positive"),
    ("identify noise.csv --window 0.001", "--window is 0.001 s; at 50 Hz a sample takes 0.02 s"),
    ("identify noise.csv --sampling-rate 0", "must be positive"),
    ("identify noise.csv --layout template.toml", "height"),
    ("identify noise.csv --json --lowest-frequency 30", "30 Hz"),
    ("identify nan.csv --json", "NaN"),
    ("identify noise.csv --zone Berlin", "zone 'Berlin' is no time zone"),
    # modes
    ("modes --theta 1,2", "three numbers"),
    ("modes --theta 1;1;1", "three numbers"),
    ("modes --theta 1,0.25,4", "k11·k22 must exceed k12²"),
    ("modes --structure iea15", "iea15"),
    ("modes --structure own.toml --sign up", "'up' is not one of"),
    ("modes --scenario modes-only", "no structural model"),
    # describe
    ("describe gone.toml", "gone.toml"),
    ("describe iea15mw", "iea15mw"),
    ("describe no-tubes.toml", "no-tubes.toml: tubes is empty"),
    ("modes --structure no-tubes.toml", "no-tubes.toml: tubes is empty"),
    ("new noise.csv -o made --structure no-tubes.toml", "no-tubes.toml: tubes is empty"),
    ("describe layout.toml", "layout.toml"),
    ("describe --plot gone/a.png", "gone"),
    # update
    ("update gone.mcap", "gone.mcap"),
    ("update noise.csv", "noise.csv"),
    ("update empty", "the folder empty holds no recording"),
    ("update short.mcap --sampler dice", "'dice' is not one of"),
    ("update short.mcap --scenario gone.toml", "gone.toml"),
    ("update short.mcap --scenario modes-only", "no structural model"),
    # calibrate
    ("calibrate gone.mcap", "gone.mcap"),
    ("calibrate short.mcap --scenario modes-only", "no structural model"),
    ("calibrate short.mcap --design 1e9,1e11", "three numbers are needed"),
    ("calibrate short.mcap --design 1e9,1e11,1e12", "not positive definite"),
    ("calibrate short.mcap -o noise.csv", "noise.csv exists"),
    ("calibrate short.mcap -o nowhere/x.toml", "the folder nowhere does not exist"),
    ("calibrate short.mcap --scenario parked", "taken as exact"),
    # reproduce
    ("reproduce --seeds 0", "--seeds is 0"),
    ("reproduce --seeds many", "a whole number is needed"),
    ("reproduce --out noise.csv", "noise.csv"),
    # an output that cannot be written is named before the work begins, which would fail otherwise
    ("reproduce --out /proc", "--out /proc: No such file or directory"),
    ("report gone.mcap -o nowhere/a.html", "-o nowhere/a.html: the folder nowhere does not exist"),
    ("report gone.mcap -o empty", "-o empty is a folder; a file is needed"),
    ("report gone.mcap -o /proc/a.html", "-o /proc/a.html cannot be written"),
    ("identify gone.csv --plot /proc/a.png", "--plot /proc/a.png cannot be written"),
    ("calibrate gone.mcap -o /proc/a.toml", "-o /proc/a.toml cannot be written"),
    # feed
    ("feed tower", "tower"),
    ("feed udp://127.0.0.1:0 --for 0", "--for 0"),
    ("feed udp://127.0.0.1:0 --layout layout.toml --scenario parked", "give one"),
    (
        "feed udp://127.0.0.1:0 --layout layout.toml --for 1 --spool-megabytes -1",
        "--spool-megabytes is -1; a number above 0 is needed",
    ),
    ("publish --source simulate:parked --spool-megabytes nan", "--spool-megabytes is nan"),
    ("feed mqtt://", "mqtt://"),
    ("feed udp://127.0.0.1:0", "where on the tower are its channels?"),
    ("feed opcua://127.0.0.1 --layout gone.toml", "gone.toml"),
    ("feed opcua://127.0.0.1?node=a --layout layout.toml", "did you mean 'nodes'?"),
    ("feed scada+opcua://127.0.0.1 --turbine t1", "which variables?"),
    ("feed scada+csv:noise.csv", "of which turbine?"),
    ("feed udp://127.0.0.1:0 --layout template.toml", "height"),
    # publish
    ("publish", "Missing option '--source'"),
    ("publish --source replay:gone.mcap", "gone.mcap"),
    ("publish --source short.mcap", "--source replay:short.mcap replays it"),
    ("publish --source noise.csv", "`pilewatch import` makes a recording"),
    ("publish --source simulate:parked --speed fast", "--speed fast"),
    ("publish --source simulate:", "which scenario?"),
    # node
    ("node", "Missing argument 'name"),
    ("node recorder --out noise.csv", "--out noise.csv: File exists; a folder is needed"),
    ("node updater", "'updater' is not one of"),
    ("node updating --recording gone.mcap", "gone.mcap"),
    ("node updating --scenario gone", "'gone' is neither"),
    ("node updating --out nd", "updating needs a structure: give --scenario NAME or FILE.toml"),
    (
        "node updating --scenario modes-only --out nd",
        "updating needs a structure: scenario modes-only has none",
    ),
    ("node viewer --no-rrd --out nd", "the viewer has nothing to draw on"),
    ("node recorder --shard 1/2 --out nd", "--shard is for identification and updating"),
    ("node updating --shard 3", "--shard '3' is not like 1/4"),
    # certificates
    ("certificates", "Missing argument 'folder'"),
    ("certificates keys", "no client is named"),
    ("certificates keys --unit tower", "tower"),
    ("certificates keys --unit t1/tower --port 99999", "--port is 99999; a port is 1 to 65535"),
    ("certificates keys --unit 't 1/to'", "--unit 't 1/to' is not TURBINE/UNIT"),
    ("certificates keys --viewer a --viewer a", "cannot name two machines"),
    # metrics
    ("metrics", "no session"),
    ("metrics --port 99999 --connect tcp/127.0.0.1:1", "--port is 99999"),
    ("metrics --port http", "a whole number is needed"),
    # notices
    ("notices gone.toml", "gone.toml"),
    ("notices noise.csv", "noise.csv"),
    ("notices layout.toml", "layout.toml"),
    # ack
    ("ack", "no"),
    ("ack first", "a whole number is needed"),
    ("ack 7 --out gone", "gone"),
    # farm
    ("farm", "no session"),
    ("farm gone.mcap", "gone.mcap"),
    ("farm short.mcap", "posterior"),
    ("farm short.mcap --follow", "FILES are recordings"),
    # reprocess
    ("reprocess gone.mcap", "gone.mcap"),
    ("reprocess empty", "empty"),
    ("reprocess short.mcap --serial --workers 2", "exclude each other"),
    ("reprocess noise.csv --serial", "noise.csv"),
    # files that are empty, of another kind, or beyond reach; a second round
    ("run --source replay:empty", "the folder empty holds no recording"),
    ("run --source replay:short.mcap --from 100 --to 50", "--from 100 --to 50 is no range"),
    ("run --source replay:short.mcap --from -5", "--from -5 is before the first sample"),
    ("run --source replay:short.mcap --from 1e9", "which is 240 s long"),
    ("run --source replay:short.mcap --loop 0", "--loop 0 plays nothing"),
    ("run --source replay:short.mcap --scenario layout.toml", "unknown key 'channels'"),
    ("run --source replay:short.mcap --speed nan", "--speed nan"),
    ("run --source replay:short.mcap --scenario hop.toml", "hop.toml [oma]: hop is 900 s"),
    ("run --source replay:short.mcap --out /proc/x", "--out /proc/x: No such file or directory"),
    ("run --source replay:zero.mcap", "zero.mcap is empty (0 bytes)"),
    ("run --source header.csv", "header.csv: 0 samples below the header"),
    ("run --source 'Türm 7.csv'", "Türm 7.csv: where on the tower are low, high?"),
    ("new zero.csv -o made", "zero.csv: the file is empty"),
    ("new empty -o made", "empty is a folder; name the files in it"),
    ("new Türm 7.csv -o made", "Türm: No such file or directory"),
    ("new noise.csv -o made --sampling-rate -50", "it must be positive"),
    ("new noise.csv -o made --zone Mars", "zone 'Mars' is no time zone"),
    ("new noise.csv -o made --scada noise.csv", "none of low, high is wind"),
    ("new noise.csv -o made --mudline -20", "are for --structure"),
    ("new noise.csv -o made --layout german.toml", "numbers have a decimal point: 40.5"),
    ("new noise.csv -o made --layout twice.toml", "twice.toml: channel 'low' is listed twice"),
    ("new back.csv -o made", "time stands still or goes back at -10.000 s"),
    ("new ragged.csv -o made", "line 32 has 4 columns where 3 are expected"),
    ("new letters.csv -o made", "no column of numbers"),
    ("new one.csv -o made", "one.csv: 1 sample; at least two are needed"),
    ("import noise.csv --layout noise.csv -o a.mcap", "noise.csv: not valid TOML"),
    ("import noise.csv --layout empty -o a.mcap", "Is a directory"),
    ("import noise.csv -o a.mcap --layout layout.toml --at-most -3", "--at-most -3"),
    ("import noise.csv -o a.mcap --layout tall.toml", "elevation 40000 m; heights are in metres"),
    ("import noise.csv -o noise.csv --layout layout.toml", "noise.csv exists already"),
    ("identify noise.csv --window nan", "--window is nan s; it must be positive"),
    ("identify noise.csv --rotor-speed -3", "--rotor-speed is -3 rpm; it must not be negative"),
    ("identify noise.csv --rotor-speed inf", "--rotor-speed is inf rpm; a finite number"),
    ("identify noise.csv --window 4,5", "'--window': '4,5'; a valid number is needed"),
    ("identify noise.csv --rotor-speed nan", "--rotor-speed is nan rpm; a finite number"),
    ("identify noise.csv --plot a.xyz", "Format 'xyz' is not supported"),
    ("identify noise.csv --lowest-frequency -1", "--lowest-frequency is -1 Hz; it must be > 0"),
    ("identify noise.csv --highest-frequency nan", "--highest-frequency is nan Hz"),
    ("identify noise.csv --highest-frequency 200", "--highest-frequency is 200 Hz; a sampling"),
    (
        "identify noise.csv --lowest-frequency 9 --highest-frequency 8",
        "--highest-frequency is 8 Hz, not above --lowest-frequency (9 Hz)",
    ),
    (
        "identify noise.csv --highest-frequency 0.01",
        "--highest-frequency is 0.01 Hz: nothing can be identified below 0.208 Hz in 30 s at 50 Hz",
    ),
    (
        "identify noise.csv --lowest-frequency 24.9",
        "--lowest-frequency is 24.9 Hz: nothing can be identified above 22.5 Hz in 30 s at 50 Hz",
    ),
    ("export short.mcap --csv -o noise.csv", "-o noise.csv: File exists; a folder is needed"),
    ("show empty", "the folder empty holds no recording"),
    ("audit empty --since 1.2.2026", "(2026-03-01T12:00Z) or seconds since 1970"),
    ("audit zero.mcap", "give the folder of a run"),
    ("calibrate short.mcap --design-std 0.2", "--design-std 0.2 is for --design"),
    (
        "calibrate short.mcap --design 1e9,1e11,1e9 --design-std -1",
        "the design springs' standard deviation is -1",
    ),
    ("describe german.toml", "numbers have a decimal point: 40.5"),
    ("describe empty", "empty: cannot be read as text: Is a directory"),
    ("simulate german.toml -o a.mcap", "numbers have a decimal point: 40.5"),
    ("simulate parked -o a.mcap --seed -1", "seed is -1"),
    ("notices german.toml --test", "numbers have a decimal point: 40.5"),
    ("notices share.toml --test", "k22_below is 95.0; it is a share of nominal, 0.95 for 95 %"),
    ("notices wrong.toml --test", "unknown section 'maill'"),
    ("feed udp://127.0.0.1:99999 --layout layout.toml", "port '99999'"),
    ("feed mqtt://127.0.0.1/t?maping=gone --layout layout.toml", "did you mean 'mapping'?"),
    ("feed mqtt://127.0.0.1/t?mapping=german.toml --layout layout.toml", "a decimal point: 40.5"),
    ("feed serial:///dev/ttyX --layout layout.toml", "is no feed; one begins with"),
    ("certificates noise.csv --unit t/tower", "a folder that can be written is needed"),
    ("reprocess short.mcap --workers 0", "'--workers': '0'; at least 1 is needed"),
    ("reprocess short.mcap -o noise.csv --serial", "a folder is needed"),
    ("node updating --shard 5/4", "--shard '5/4' is not like 1/4"),
    ("publish --source live", "--source live is what others publish"),
    ("farm zero.mcap", "zero.mcap is empty (0 bytes)"),
    ("info zero.mcap", "zero.mcap is empty (0 bytes): nothing was recorded; it can be moved away"),
    ("report zero.mcap", "zero.mcap is empty (0 bytes)"),
    ("salvage zero.mcap -o a.mcap", "zero.mcap is empty (0 bytes)"),
    ("export zero.mcap --csv", "zero.mcap is empty (0 bytes)"),
    (
        "simulate parked --duration 0.01 -o tiny.mcap",
        "duration is 0.01 s: no sample at 40 Hz; at least 0.025 s are needed",
    ),
    # pilewatch itself
    ("cook", "No such command 'cook'"),
    ("run --sorce live", "No such option"),
    ("--verbos run", "No such option"),
)

LAYOUT = """
turbine = "mast"
[[channels]]
name = "low"
elevation = 20.0
direction = [1, 0, 0]
[[channels]]
name = "{second}"
elevation = 40.0
direction = [1, 0, 0]
"""

DECK = """------- ELASTODYN v1.03.* INPUT FILE -----
NREL 5.0 MW Baseline
---------------------- SIMULATION CONTROL ----
False         Echo        - Echo input data (flag)
          3   Method      - Integration method (-)
"DEFAULT"     DT          Integration time step (s)
True          FlapDOF1    - First flapwise blade mode DOF (flag)
"""

SPRINGS = """
[foundation]
k11 = 0.098e11
k22 = 8.238e11
k12 = 0.678e11
sign = "published"
[materials.monopile]
youngs_modulus = 210e9
density = 7850.0
[materials.tower]
youngs_modulus = 210e9
density = 8500.0
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, short_recording: Path) -> Path:
    """Files with which mistakes are made."""
    place = tmp_path_factory.mktemp("mistakes")
    long_noise = np.random.default_rng(3).standard_normal((3000, 2))
    noise = long_noise[:1500]
    for name, samples in (
        ("noise", noise),
        ("nan", np.full((1500, 2), np.nan)),
        ("constant", np.ones((1500, 2))),
        ("brief", noise[:40]),
    ):
        table = np.column_stack([np.arange(len(samples)) / 50.0, samples])
        header = "time [s],low [g],high [g]"
        np.savetxt(place / f"{name}.csv", table, delimiter=",", header=header, comments="")
    wind = np.column_stack([np.arange(1500) / 50.0, 9.0 + noise[:, 0]])
    np.savetxt(place / "wind.csv", wind, delimiter=",", header="time [s],Wind [m/s]", comments="")
    means = np.column_stack([np.arange(500) * 600.0, noise[:500]])
    np.savetxt(
        place / "means.csv", means, delimiter=",", header="time [s],z80-fa,z80-ss", comments=""
    )
    np.savetxt(place / "no-time.csv", noise, delimiter=",", header="low,high", comments="")
    (place / "text.mcap").write_text("This is a text.")
    (place / "layout.toml").write_text(LAYOUT.format(second="high"))
    (place / "other.toml").write_text(LAYOUT.format(second="tip"))
    (place / "alone.json5").write_text('{mode: "peer", scouting: {multicast: {enabled: false}}}')
    (place / "own.toml").write_text(shipped_text("iea15mw_monopile"))
    head, _, tubes = shipped_text("iea15mw_monopile").partition("tubes = [")
    (place / "no-tubes.toml").write_text(f"{head}tubes = []{tubes.partition(chr(10) + ']')[2]}")
    low = shipped_text("iea15mw_monopile").split("  { bottom = 28.0")[0] + "]\n"
    (place / "low.toml").write_text(low + SPRINGS)
    (place / "low-scenario.toml").write_text('[turbine]\ndescription = "low.toml"\n')
    (place / "lost-tower.toml").write_text('[turbine]\ndescription = "nosuch.toml"\n')
    (place / "lost-farm.toml").write_text('[updating]\npopulation = "nosuch.json"\n')
    (place / "cut.mcap").write_bytes(short_recording.read_bytes()[:2000])
    (place / "empty").mkdir()
    (place / "zero.csv").write_text("")
    (place / "tower.dat").write_text("This is a text.")
    (place / "zero.mcap").write_bytes(b"")
    (place / "deck.dat").write_text(DECK)
    (place / "hop.toml").write_text("[oma]\nwindow_duration = 600\nhop = 900\n")
    (place / "header.csv").write_text("time [s],low,high\n")
    (place / "one.csv").write_text("time [s],low,high\n0,1,2\n")
    (place / "letters.csv").write_text("name,place\n" + "a,b\n" * 50)
    rows = [f"{i / 50},1,2" for i in range(100)]
    rows[30] += ",7"
    (place / "ragged.csv").write_text("\n".join(["time [s],low,high", *rows]))
    clock = np.arange(3000) / 50.0
    clock[1500:] -= 40.0  # set anew in the middle
    table = np.column_stack([clock, long_noise])
    header = "time [s],low [g],high [g]"
    np.savetxt(place / "back.csv", table, delimiter=",", header=header, comments="")
    (place / "german.toml").write_text(LAYOUT.format(second="high").replace("40.0", "40,5"))
    (place / "twice.toml").write_text(LAYOUT.format(second="low"))
    (place / "tall.toml").write_text(LAYOUT.format(second="high").replace("40.0", "40000.0"))
    (place / "share.toml").write_text("[notices]\nk22_below = 95\n")
    (place / "wrong.toml").write_text('[maill]\nto = "a@example.org"\n')
    os.link(place / "noise.csv", place / "Türm 7.csv")
    os.link(short_recording, place / "short.mcap")
    return place


@pytest.fixture(scope="module", autouse=True)
def template(folder: Path) -> None:
    """A layout template that was not filled in."""
    from sensors.files.formats import channels_in
    from sensors.files.layout_file import layout_template

    text = layout_template(channels_in(folder / "noise.csv", None))
    (folder / "template.toml").write_text(text)


@pytest.mark.parametrize(("line", "words"), MISTAKES, ids=[line for line, _ in MISTAKES])
def test_a_mistake_is_one_line(
    line: str,
    words: str,
    folder: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(folder)
    before = {path.name for path in folder.iterdir()}
    monkeypatch.setattr(sys, "argv", ["pilewatch", *shlex.split(line)])
    with pytest.raises(SystemExit) as ended:
        main()
    printed = capsys.readouterr()
    lines = printed.err.splitlines()
    assert ended.value.code == 2, printed.err
    assert len(lines) == 1, printed.err
    assert lines[0].startswith("pilewatch: ")
    assert words in lines[0]
    assert not printed.out.strip()
    assert {path.name for path in folder.iterdir()} - before <= {"keys", "out", "results"}


def test_every_command_has_three_mistakes_or_more() -> None:
    counts = Counter(line.split()[0] for line, _ in MISTAKES)
    commands = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    assert {name: counts[name] for name in commands if counts[name] < 3} == {}
    assert len(MISTAKES) >= 76
