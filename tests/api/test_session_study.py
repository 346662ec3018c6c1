"""Groups of sessions and questionnaires: rank tests against counting, scores at published limits, refused input."""

from __future__ import annotations

import json
from itertools import pairwise, product

import numpy as np
import pytest

from twin.api.session_study import measures, study_sessions
from twin.cli import main
from twin.core.errors import DescriptionError
from twin.simulation.tasks.guide.guiding_referee import GuideMeasures
from twin.simulation.tasks.transfer.ring_referee import BoardMeasures
from twin.ui.report.study_figures import figure
from twin.validation.questionnaires import keys
from twin.validation.rank_tests import compare, label

KEYS = {k.name: k for k in keys()}


def table(tmp_path, text):
    file = tmp_path / "users.csv"
    file.write_text(text)
    return file


def answers(name, *rows):
    """Return a CSV of users with answers; a row is (group, one answer for all items, or a list)."""
    key = KEYS[name]
    lines = [",".join(["group", *key.columns])]
    for group, given in rows:
        given = [given] * len(key.item) if isinstance(given, int) else given
        lines.append(",".join([group, *map(str, given)]))
    return "\n".join(lines) + "\n"


# -- effect size -------------------------------------------------------------------------------------------------


def test_the_effect_counts_pairs_with_ties_as_half(tmp_path):
    """Cliff's delta and the measure A of Vargha and Delaney, from their definitions."""
    a, b = [3, 5, 5, 8, 9], [1, 3, 5, 5, 5, 7]
    text = "group,errors\n" + "".join(f"A,{x}\n" for x in a) + "".join(f"B,{x}\n" for x in b)
    (c,) = compare(table(tmp_path, text)).comparisons
    above = sum(x > y for x, y in product(a, b))
    below = sum(x < y for x, y in product(a, b))
    equal = len(a) * len(b) - above - below
    assert c.effect == pytest.approx((above - below) / (len(a) * len(b)))
    assert c.superiority == pytest.approx((above + equal / 2) / (len(a) * len(b)))
    assert not c.exact  # ties


def test_repeated_sessions_compare_last_ones_and_the_first_with_the_last(tmp_path):
    rng = np.random.default_rng(0)
    rows = [
        (g, n, 100 - 10 * n * (g == "VR") + rng.normal()) for g in ("VR", "box") for n in (1, 2, 3) for _ in range(5)
    ]
    text = "user,group,session,time_s\n" + "".join(f"u{k},{g},{n},{x}\n" for k, (g, n, x) in enumerate(rows))
    found = compare(table(tmp_path, text))
    pairs = {c.groups: c for c in found.comparisons}
    assert set(pairs) == {
        ("VR, session 1", "VR, session 3"),
        ("box, session 1", "box, session 3"),
        ("VR, session 3", "box, session 3"),
    }
    assert pairs["VR, session 1", "VR, session 3"].effect == 1
    assert pairs["VR, session 3", "box, session 3"].effect == -1
    assert "study.repeated" in [f.code for f in found.findings]


# -- questionnaires ----------------------------------------------------------------------------------------------


def test_ssq_reaches_the_published_maxima(tmp_path):
    """All symptoms severe: N 200.34, O 159.18, D 292.32, total 235.62; every scale has seven items (Kennedy et al.)."""
    ssq = KEYS["ssq"]
    assert ssq.scores([0] * 16) == dict.fromkeys(ssq.scores([0] * 16), 0)
    expected = {"nausea": 200.34, "oculomotor": 159.18, "disorientation": 292.32, "total": 235.62}
    assert ssq.scores([3] * 16) == pytest.approx({f"ssq_{n}": v for n, v in expected.items()})
    for scale in ssq.scale:
        assert sum(scale in item.scales for item in ssq.item) == 7


def test_one_symptom_of_the_ssq_counts_in_its_scales():
    ssq = KEYS["ssq"]
    nausea = ssq.scores([2 if item.name == "nausea" else 0 for item in ssq.item])
    assert nausea == pytest.approx(
        {"ssq_nausea": 19.08, "ssq_oculomotor": 0, "ssq_disorientation": 27.84, "ssq_total": 14.96}
    )


def test_ueq_is_three_at_the_positive_word_of_every_item():
    ueq = KEYS["ueq"]
    best = [1 if item.reversed else 7 for item in ueq.item]
    assert set(ueq.scores(best).values()) == {3.0}
    assert set(ueq.scores([8 - x for x in best]).values()) == {-3.0}
    assert set(ueq.scores([4] * 26).values()) == {0.0}
    counts = {scale: sum(scale in item.scales for item in ueq.item) for scale in ueq.scale}
    assert counts.pop("attractiveness") == 6
    assert set(counts.values()) == {4}


def test_answers_become_scores_that_are_compared(tmp_path):
    text = answers("ueq", ("A", 4), ("A", 4), ("B", [1 if i.reversed else 7 for i in KEYS["ueq"].item]), ("B", 4))
    found = compare(table(tmp_path, text))
    assert {c.measure for c in found.comparisons} == {f"ueq_{n}" for n in KEYS["ueq"].scale}
    assert found.users.measures["ueq_novelty"] == [0, 0, 3, 0]
    assert [f.code for f in found.findings if "Handbook" in f.message] == ["study.scored"]


NASA_TLX = "group," + ",".join([f"nasatlx_{k}" for k in range(1, 7)] + [f"nasatlx_w{k}" for k in range(1, 7)]) + "\n"


def test_nasa_tlx_is_weighted_by_the_comparisons_of_pairs(tmp_path):
    """By hand: (5 * 80 + 0 * 20 + 4 * 60 + 1 * 40 + 3 * 50 + 2 * 30) / 15 = 890 / 15; without weights 280 / 6."""
    rows = "A,80,20,60,40,50,30,5,0,4,1,3,2\nA,0,0,0,0,0,0,0,1,2,3,4,5\n"
    rows += "B,100,100,100,100,100,100,5,4,3,2,1,0\nB,50,,0,0,0,0,5,4,3,2,1,0\n"
    measures = compare(table(tmp_path, NASA_TLX + rows)).users.measures
    assert measures["nasatlx_weighted"][:3] == pytest.approx([890 / 15, 0, 100])
    assert measures["nasatlx_raw"][:3] == pytest.approx([280 / 6, 0, 100])
    assert np.isnan(measures["nasatlx_weighted"][3])
    assert measures["nasatlx_mental"] == [80, 0, 100, 50]
    assert not [name for name in measures if "_w1" in name]


def test_raw_nasa_tlx_needs_no_weights(tmp_path):
    text = answers("nasatlx", ("A", 50), ("A", 60), ("B", 70), ("B", 80))
    measures = compare(table(tmp_path, text)).users.measures
    assert measures["nasatlx_raw"] == [50, 60, 70, 80]
    assert "nasatlx_weighted" not in measures


def test_a_missing_answer_leaves_its_scores_empty(tmp_path):
    text = answers("ssq", ("A", 0), ("A", ["", *[1] * 15]), ("B", 1), ("B", 2))
    users = compare(table(tmp_path, text)).users
    assert np.isnan(users.measures["ssq_nausea"][1])
    assert users.measures["ssq_disorientation"][1] == pytest.approx(7 * 13.92)


def test_sim_tlx_raw_and_weighted(tmp_path):
    """By hand: the sum of k (8 - k) for k = 0 to 8 is 84, so that ratings of 10 k give 840 / 36; raw 360 / 9 = 40."""
    head = ",".join([f"simtlx_{k}" for k in range(1, 10)] + [f"simtlx_w{k}" for k in range(1, 10)])
    ratings = [10 * k for k in range(9)]
    weights = [8 - k for k in range(9)]
    first = [*ratings, *weights]
    row = ",".join(map(str, first))
    others = ",".join(map(str, [50] * 9 + weights))
    found = compare(table(tmp_path, f"group,{head}\nA,{row}\nA,{others}\nB,{others}\nB,{row}\n"))
    measures = found.users.measures
    assert measures["simtlx_weighted"] == pytest.approx([840 / 36, 50, 50, 840 / 36])
    assert measures["simtlx_raw"] == [40, 50, 50, 40]
    assert measures["simtlx_control"] == [80, 50, 50, 80]


def test_face_validity_has_medians_and_items_for_surgeons_only(tmp_path):
    """Five points; users who are no surgeons leave the last four empty."""
    head = ",".join(f"facevalidity_{k}" for k in range(1, 9))
    rows = ["RS,5,4,3,5,4,4,2,5", "RS,4,4,3,5,4,3,2,5", "RS,4,5,2,4,3,3,1,4", "CTRL,3,3,3,3,,,,", "CTRL,4,3,1,2,,,,"]
    found = compare(table(tmp_path, f"group,{head}\n" + "\n".join(rows) + "\n"))
    by_measure = {c.measure: c for c in found.comparisons}
    assert by_measure["facevalidity_instruments"].medians == (4, 3.5)
    assert by_measure["facevalidity_images"].medians == (4, 3)
    assert "facevalidity_triangulation" not in by_measure  # only one group has answered
    assert found.users.measures["facevalidity_triangulation"][:3] == [4, 4, 3]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (
            "group,ssq_1,ssq_2\nA,1,1\nB,1,1\n",
            r"users\.csv:1: SSQ needs the columns ssq_1 to ssq_16; ssq_3, .* are missing",
        ),
        (answers("ssq", ("A", 1), ("B", 4)), r"users\.csv:3: ssq_1 is 4; give an integer, 0 to 3"),
        (answers("ueq", ("A", 1), ("B", 0)), r"users\.csv:3: ueq_1 is 0; give an integer, 1 to 7"),
        (answers("nasatlx", ("A", 50), ("B", 52)), r"csv:3: nasatlx_1 is 52; give a multiple of 5, 0 to 100"),
        (
            NASA_TLX + "A,80,20,60,40,50,30,5,0,4,1,3,3\n",
            r"csv:2: the weights nasatlx_w1 to nasatlx_w6 have the sum 16; 15 comparisons",
        ),
        (NASA_TLX + "A,80,20,60,40,50,30,6,0,4,1,3,1\n", r"csv:2: nasatlx_w1 is 6; give an integer, 0 to 5"),
        (NASA_TLX.replace(",nasatlx_w6", "") + "A,1,1,1,1,1,1,5,0,4,1,3\n", "nasatlx_w6 is missing"),
        (answers("ueq", ("A", 1)).replace("ueq_26", "ueq_27"), "ueq_26 is missing"),
        ("group,time\nA,1\nA,2\n ,3\nB,4\n", ":4: group is empty; give the name of the user's group"),
        ("group,time,time\nA,1,2\nB,1,2\n", "the header has 'time' twice"),
        ("group,time\nA,1\nB,2\n", "every group has only one session or user"),
        ("group,session,time\nA,,1\nB,1,2\n", r"users\.csv:2: session is ''; give the number of the session"),
        ("group,time\n", "nothing to compare"),
        ("", "the header needs a column 'group'"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, text, why):
    with pytest.raises(DescriptionError, match=why):
        compare(table(tmp_path, text))


# -- sessions ----------------------------------------------------------------------------------------------------


def session(folder, name, time, task="camera", angle=0.1, **more):
    """Write what `twin session --out` writes of a session, as far as it is compared; return its path."""
    hand = {"hand": "right", "robot": "psm1", "path_mm": 10 * time}
    align = {"time_s": time, "align_err_deg": angle, "lens_path_mm": 40.0}
    path = folder / f"{name}.json"
    content = {"schema": "twin/session/1", "scene": "davinci", "task": task, "time_s": time + 1, "hands": [hand]}
    path.write_text(json.dumps(content | {"clutches": 2, "camera_moves": 3, "alignment": align, **more}))
    return path


@pytest.fixture
def four(tmp_path):
    return {
        "first": [session(tmp_path, f"a{k}", 100 + k, angle=-0.3) for k in range(4)],
        "last": [session(tmp_path, f"b{k}", 50 + k) for k in range(4)],
    }


def test_sessions_of_two_groups_are_compared(four):
    found = study_sessions(four)
    by_measure = {c.measure: c for c in found.comparisons}
    assert by_measure["time_s"].p == pytest.approx(2 / 70)
    assert by_measure["time_s"].effect == 1
    assert by_measure["time_s"].exact
    assert by_measure["align_err_deg"].effect == -1
    assert by_measure["align_err_size_deg"].effect == 1
    assert found.users.sessions == [1, 2, 3, 4, 1, 2, 3, 4]


def test_sessions_are_not_called_users(tmp_path, capsys):
    files = [f"{g}={session(tmp_path, f'{g}{k}', 10 * k + 50)}" for g in ("first", "last") for k in range(2)]
    assert main(["study", *files]) == 0
    said = capsys.readouterr().out
    assert "first and last have 2 and 2 sessions: with so few sessions, p cannot be below 0.333" in said
    assert "users" not in said


def test_the_command_writes_page_boxes_and_table(four, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["study", *(f"{g}={f}" for g, files in four.items() for f in files), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "Cliff's delta" in said
    for shown in ("Time [s] ", "Path of psm1 [mm] ", "Clutch presses ", "Path of the lens [mm] ", "AlignErr [deg] "):
        assert shown in said
        assert shown.strip() in (out / "study.html").read_text()
    assert "_" not in said.partition("effect:")[0]
    assert {p.name for p in out.iterdir()} == {"study.html", "study.json", "study.png", "users.csv"}
    again = compare(out / "users.csv")
    assert {c.measure for c in again.comparisons} >= {"time_s", "align_err_deg"}


@pytest.mark.slow
def test_names_below_the_boxes_do_not_overlap(tmp_path):
    """Neither with several sessions of long groups, nor with many groups; a group's colour is that of its curve."""
    groups = {"by the console": 3, "by laparoscopy": 3}
    rows = [f"{g},{n},{k + n}" for g, most in groups.items() for n in range(1, most + 1) for k in range(4)]
    sessions = "group,session,time\n" + "\n".join(rows)
    many = "group,time\n" + "\n".join(f"surgeons of hospital {k},{k + j}" for k in range(6) for j in range(4))
    for text in (sessions, many):
        drawn = figure(compare(table(tmp_path, text)))
        drawn.canvas.draw()
        boxes = [t.get_window_extent() for t in drawn.axes[0].get_xticklabels()]
        assert len(boxes) == (4 if text is sessions else 6)
        assert all(a.x1 < b.x0 for a, b in pairwise(boxes))
        dots = [line.get_color() for line in drawn.axes[0].lines if line.get_marker() == "o"]
        assert text is many or dots[0] == dots[1] != dots[2] == dots[3]


@pytest.mark.parametrize(
    ("measure", "expected"),
    [
        ("raven_left_path_mm", "Path of raven_left [mm]"),
        ("trials_n", "Trials n"),
        ("gap_min", "Gap min"),
        ("success_percent", "Success [%]"),
        ("insertion_depth", "Insertion depth"),
        ("nasa tlx", "Nasa tlx"),
        ("mm", "mm"),
        ("time", "Time"),
        ("pH", "pH"),
    ],
)
def test_a_measure_is_labelled_with_its_unit(measure, expected):
    assert label(measure) == expected


def test_every_measure_of_a_scoreboard_has_its_label():
    board = {"time_s": 1, "rings_transferred": 4, "rings_dropped": 1, "instrument_collisions": 2, "errors": 3}
    guided = GuideMeasures({"released": 4.0, "retracted": None}, 0.5, 2, 0.1, 1, 3, 60.0, [])
    for shown, found in ((BoardMeasures([], 0, 0.0), {"board": board}), (guided, {"guided": guided.content()})):
        content = {"time_s": 61, "hands": [], "clutches": 0, "camera_moves": 0, **found}
        labels = {label(name).partition(" [")[0] for name in measures(content)}
        assert labels >= {name for name, _ in shown.rows()}
    assert measures(content)["steps_done"] == 1
    assert measures(content)["wire_passed_percent"] == 50


def test_a_folder_stands_for_its_session(four, tmp_path):
    folder = tmp_path / "operated"
    folder.mkdir()
    four["last"][0].rename(folder / "session.json")
    found = study_sessions(four | {"last": [folder, *four["last"][1:]]})
    assert found.comparisons[0].counts == (4, 4)
    with pytest.raises(DescriptionError, match=r"session\.json: cannot be read: No such file"):
        study_sessions(four | {"last": [tmp_path]})


def test_a_session_that_differed_from_its_recording_is_refused(four, tmp_path):
    other = session(tmp_path, "other", 80, replay="differs")
    with pytest.raises(DescriptionError, match=r"other\.json: the replay of this session differed"):
        study_sessions({**four, "last": [*four["last"], other]})


def test_an_interrupted_session_is_named(four, tmp_path):
    other = session(tmp_path, "other", 80, findings=[{"code": "session.interrupted"}])
    found = study_sessions({**four, "last": [*four["last"], other]})
    (finding,) = [f for f in found.findings if f.code == "study.interrupted"]
    assert finding.where == str(other)
    assert not [f for f in study_sessions(four).findings if f.code == "study.interrupted"]


def test_a_session_in_which_nothing_began_is_not_the_fastest(four, tmp_path):
    content = json.loads(session(tmp_path, "other", 80).read_text())
    idle = measures(content | {"time_s": 0.0, "alignment": None})
    assert np.isnan(idle["time_s"])
    assert idle["psm1_path_mm"] == 800


def test_measures_of_a_peg_board_are_the_papers():
    board = {"time_s": 200, "rings_transferred": 4, "rings_dropped": 1, "instrument_collisions": 2, "errors": 3}
    hands = [{"robot": "psm1", "path_mm": 5}]
    content = {"time_s": 210, "hands": hands, "clutches": 0, "camera_moves": 0, "board": board}
    found = measures(content)
    assert (found["time_s"], found["errors"], found["psm1_path_mm"]) == (200, 3, 5)


@pytest.mark.parametrize("content", [{}, {"scene": "s", "task": None, "time_s": 1.0, "hands": [3]}])
def test_a_damaged_session_json_is_refused(content, tmp_path):
    file = tmp_path / "session.json"
    file.write_text(json.dumps({"schema": "twin/session/1", **content}))
    with pytest.raises(DescriptionError, match=r"session\.json: .*damaged"):
        study_sessions({"a": [file], "b": [file]})


def test_sessions_that_cannot_be_compared_are_refused(four, tmp_path):
    other = session(tmp_path, "other", 80, task="pegboard")
    with pytest.raises(DescriptionError, match=r"session of davinci, task pegboard: the tasks must be equal"):
        study_sessions({**four, "last": [other]})
    with pytest.raises(DescriptionError, match="give a second one to compare"):
        study_sessions({"first": four["first"]})
    with pytest.raises(DescriptionError, match="only one session or user"):
        study_sessions({"first": four["first"][:1], "last": four["last"][:1]})
    (tmp_path / "no.json").write_text("{}")
    with pytest.raises(DescriptionError, match=r"no\.json: this is not the session\.json"):
        study_sessions({"a": [tmp_path / "no.json"], "b": four["last"]})
    (tmp_path / "cut.json").write_text("{")
    with pytest.raises(DescriptionError, match="cannot be read"):
        study_sessions({"a": [tmp_path / "cut.json"], "b": four["last"]})


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["a.csv", "b.csv"], "2 names or files are given"),
        (["first=a.session", "b.session"], "'b.session' has no group"),
        (["=a.session", "b=c.session"], "give GROUP=FILE"),
        (["sher", "--out", "x"], "--out requires groups"),
    ],
)
def test_wrong_arguments_are_refused(given, why, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["study", *given]) == 2
    assert why in capsys.readouterr().err
