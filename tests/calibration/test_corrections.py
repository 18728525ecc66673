"""Calibration of logits: known corrections are recovered, missions held out decide which is used, and what
is baked into an ONNX graph computes the same."""

import json
from collections.abc import Sequence

import numpy as np
import onnx
import onnxruntime
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from onnx import TensorProto, helper, numpy_helper

from crowdfence.calibration.choice import calibrate
from crowdfence.calibration.correction import (
    FITS,
    LogitMap,
    fit_curve,
    fit_scale_and_bias,
    fit_temperature,
    line,
    negative_log_likelihood,
    sigmoid,
)
from crowdfence.calibration.graph import PREFIX, bake, write_contract
from crowdfence.calibration.logit_counts import logit_counts
from crowdfence.errors import DetectorError

CURVE = LogitMap("curve", ((-3.0, -4.0), (-1.0, -1.0), (0.5, -1.0), (2.0, 4.0)), 1.0, 0.5)


def cells(seed: int, count: int, *, scale: float = 1.0, bias: float = 0.0) -> NDArray[np.float64]:
    """Counts of cells of a detector whose true logit is scale * logit + bias."""
    rng = np.random.default_rng(seed)
    logits = rng.normal(-1.0, 2.0, count)
    crowd = rng.random(count) < sigmoid(scale * logits + bias)
    return logit_counts(sigmoid(logits), crowd)


def test_temperature_by_hand() -> None:
    """Logits +2 (3 of 4 are crowd) and -2 (1 of 4): the best scale gives logit(3/4) = log 3 at 2."""
    values = sigmoid(np.array([2.0] * 4 + [-2.0] * 4))
    crowd = np.array([1, 1, 1, 0, 0, 0, 0, 1], np.bool_)
    counts = logit_counts(values, crowd)
    fitted = fit_temperature(counts)
    assert fitted.scale == pytest.approx(np.log(3.0) / 2.0)
    expected = -(6 * np.log(3 / 4) + 2 * np.log(1 / 4)) / 8
    assert negative_log_likelihood(counts, fitted) == pytest.approx(expected)


@given(st.floats(0.3, 3.0))
def test_a_temperature_known_by_construction_is_recovered(temperature: float) -> None:
    fitted = fit_temperature(cells(1, 100_000, scale=1.0 / temperature))
    assert 1.0 / fitted.scale == pytest.approx(temperature, rel=0.05)
    assert fitted.bias == 0.0


def test_scale_and_bias_known_by_construction_are_recovered() -> None:
    fitted = fit_scale_and_bias(cells(2, 100_000, scale=0.7, bias=-1.2))
    assert (fitted.scale, fitted.bias) == pytest.approx((0.7, -1.2), abs=0.03)


def test_a_curve_follows_what_no_line_can() -> None:
    """True shares: 1 % below logit 0, 50 % above."""
    rng = np.random.default_rng(3)
    logits = rng.normal(0.0, 3.0, 200_000)
    counts = logit_counts(sigmoid(logits), rng.random(logits.size) < np.where(logits < 0.0, 0.01, 0.5))
    fitted = fit_curve(counts)
    assert sigmoid(fitted(np.array([-3.0, 3.0]))) == pytest.approx([0.01, 0.5], abs=0.02)
    assert negative_log_likelihood(counts, fitted) < negative_log_likelihood(
        counts, fit_scale_and_bias(counts)
    )


@given(
    st.lists(st.tuples(st.floats(0.0, 1.0), st.booleans()), min_size=1, max_size=60),
    st.sampled_from([name for name in FITS if name != "none"]),
)
def test_no_fit_fails_and_every_fit_keeps_the_order(labelled: list[tuple[float, bool]], name: str) -> None:
    """Also for cells of one kind, of one value, separated perfectly, and at 0 and 1."""
    values, crowd = np.array([value for value, _ in labelled]), np.array([truth for _, truth in labelled])
    fitted = FITS[name](logit_counts(values, crowd))
    logits = np.linspace(-20.0, 20.0, 101)
    assert np.isfinite(fitted(logits)).all()
    assert (np.diff(fitted(logits)) >= -1e-9).all()


@given(st.integers(0, 2**32 - 1))
def test_fitting_never_makes_the_fitted_cells_less_likely(seed: int) -> None:
    counts = cells(seed, 200, scale=0.5, bias=0.5)
    unchanged = negative_log_likelihood(counts, FITS["none"](counts))
    scaled = negative_log_likelihood(counts, fit_temperature(counts))
    both = negative_log_likelihood(counts, fit_scale_and_bias(counts))
    assert both <= scaled + 1e-9 <= unchanged + 2e-9


def test_counts_of_frames_add_up_in_any_order() -> None:
    """What is fitted depends on the cells alone, not on how frames share them or on their order."""
    rng = np.random.default_rng(5)
    values = sigmoid(rng.normal(-1.0, 2.0, 1000))
    crowd = rng.random(1000) < values**2
    whole = logit_counts(values, crowd)
    order = rng.permutation(1000)
    parts = sum(logit_counts(values[part], crowd[part]) for part in np.split(order, [1, 300, 999]))
    np.testing.assert_allclose(parts, whole, atol=1e-9)
    for fit in FITS.values():
        np.testing.assert_allclose(fit(parts)(X.ravel()), fit(whole)(X.ravel()), atol=1e-6)


def missions(count: int = 6, **true: float) -> dict[str, NDArray[np.float64]]:
    return {f"mission {seed}": cells(seed, 20_000, **true) for seed in range(count)}


@pytest.mark.parametrize(
    ("true", "method"),
    [({}, "none"), ({"scale": 0.5}, "temperature"), ({"scale": 0.5, "bias": -1.0}, "scale and bias")],
)
def test_the_simplest_sufficient_correction_is_chosen(true: dict[str, float], method: str) -> None:
    result = calibrate(missions(**true))
    assert result.chosen.method == method
    assert (result.missions, result.cells) == (6, 120_000)
    after = result.after
    assert after is not None
    assert after.calibration_error_above.value < 0.02
    if method != "none":
        assert result.before.calibration_error_above.value > 0.08
    document = json.loads(json.dumps(result.to_json(), allow_nan=False))
    assert document["method"] == method and set(document["held_out_nll"]) == set(FITS)
    assert document["error_above_0.05"] == pytest.approx(after.calibration_error_above.value, abs=1e-6)


def test_a_mission_of_which_no_cell_counts_decides_nothing() -> None:
    """All of it may be ignored: its likelihood is 0 / 0, and beside it no correction looked better."""
    known = missions(scale=0.5)
    result = calibrate({**known, "all ignored": np.zeros_like(known["mission 0"])})
    assert result.chosen.method == "temperature"
    assert result.missions == 6
    assert all(np.isfinite(one.held_out_nll).all() for one in result.candidates.values())


def test_a_mission_is_judged_by_the_fit_of_the_others() -> None:
    """Two missions that need opposite corrections: what helps one hurts the other, nothing is chosen."""
    opposed = {"a": cells(1, 20_000, bias=2.0), "b": cells(2, 20_000, bias=-2.0)}
    result = calibrate(opposed)
    assert result.chosen.method == "none"
    assert (result.candidates["scale and bias"].held_out_nll > result.candidates["none"].held_out_nll).all()


def test_one_mission_with_crowd_gives_a_temperature_that_nothing_vouches_for() -> None:
    crowd_free = logit_counts(np.full(1000, 0.01), np.zeros(1000, np.bool_))
    result = calibrate({"a": cells(1, 20_000, scale=0.5, bias=-1.0), "empty": crowd_free})
    assert result.chosen.method == "temperature"
    assert result.after is None
    assert result.to_json()["error_above_0.05"] is None
    assert result.before.calibration_error_above.value > 0.1


@pytest.mark.parametrize(
    ("crowd", "message"), [(False, "no crowd cells among 3"), (True, "no crowd-free cells")]
)
def test_cells_of_one_kind_cannot_calibrate(crowd: bool, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        calibrate({"a": logit_counts(np.full(3, 0.5), np.full(3, crowd))})


def model(tail: Sequence[str], *, opset: int = 17, dtype: int = TensorProto.FLOAT) -> onnx.ModelProto:
    """x [1, 1, h, w] -> Mul by 2 -> `tail` operators -> "heatmap"; a second output shows the logits too."""
    scale = numpy_helper.from_array(np.array(2.0, helper.tensor_dtype_to_np_dtype(dtype)), "two")
    names = ["logits", *(f"step {number}" for number in range(len(tail) - 1)), "heatmap"]
    nodes = [helper.make_node("Mul", ["x", "two"], [names[0] if tail else "heatmap"])]
    for number, operator in enumerate(tail):
        source = [names[number], "two"] if operator == "Pow" else [names[number]]
        nodes.append(helper.make_node(operator, source, [names[number + 1]]))
    outputs = ["heatmap", "logits"] if tail else ["heatmap"]
    shape = [1, 1, None, None]
    graph = helper.make_graph(
        nodes,
        "small",
        [helper.make_tensor_value_info("x", dtype, shape)],
        [helper.make_tensor_value_info(name, dtype, shape) for name in outputs],
        [scale],
    )
    made = helper.make_model(graph, opset_imports=[helper.make_opsetid("", opset)], ir_version=8)
    made.metadata_props.add(key="author", value="somebody")
    return made


def outputs(made: onnx.ModelProto, x: NDArray[np.float32]) -> list[NDArray[np.float32]]:
    session = onnxruntime.InferenceSession(made.SerializeToString(), providers=["CPUExecutionProvider"])
    return list(session.run(None, {"x": x}))


X = np.linspace(-5.0, 5.0, 48, dtype=np.float32).reshape(1, 1, 6, 8)


@pytest.mark.parametrize("logit_map", [line("temperature", 0.7), line("scale and bias", 1.4, -0.6), CURVE])
@pytest.mark.parametrize("tail", [["Sigmoid"], ["Sigmoid", "Identity"]])
def test_a_baked_probability_is_that_of_the_corrected_logits(logit_map: LogitMap, tail: list[str]) -> None:
    before = model(tail)
    untouched = before.SerializeToString()
    heatmap, logits = outputs(bake(before, logit_map, "heatmap", "probability"), X)
    np.testing.assert_allclose(heatmap, sigmoid(logit_map(2.0 * X.astype(np.float64))), atol=1e-6)
    np.testing.assert_array_equal(logits, 2.0 * X)  # the other output stays as it was
    assert before.SerializeToString() == untouched


@pytest.mark.parametrize("logit_map", [line("scale and bias", 1.4, -0.6), CURVE])
def test_baked_logits_are_corrected_under_the_same_name(logit_map: LogitMap) -> None:
    (heatmap,) = outputs(bake(model([]), logit_map, "heatmap", "logits"), X)
    np.testing.assert_allclose(heatmap, logit_map(2.0 * X.astype(np.float64)), atol=1e-4)


@pytest.mark.parametrize("logit_map", [line("scale and bias", 0.25, -0.6), CURVE])
@pytest.mark.parametrize("kind", ["probability", "logits"])
def test_what_lies_beyond_the_limit_of_the_fit_is_corrected_as_it_was_fitted(
    logit_map: LogitMap, kind: str
) -> None:
    """Fitted were logits cut at 16; a graph that goes on from there is surer than all that was counted."""
    made = model(["Sigmoid"] if kind == "probability" else [])
    x = np.array([-40.0, -20.0, -8.0, 8.0, 20.0, 40.0], np.float32).reshape(1, 1, 2, 3)
    given = outputs(bake(made, logit_map, "heatmap", kind), x)[0]  # type: ignore[arg-type]
    expected = logit_map(np.clip(2.0 * x.astype(np.float64), -16.0, 16.0))
    np.testing.assert_allclose(given, expected if kind == "logits" else sigmoid(expected), atol=1e-5)


def test_no_number_stays_no_number() -> None:
    """What a detector refuses of the model it refuses of the calibrated one, too."""
    x = np.array([np.nan, np.inf, -np.inf, 1.0], np.float32).reshape(1, 1, 2, 2)
    for tail, kind, refused in (
        ([], "logits", [True, True, True, False]),
        (["Sigmoid"], "probability", [True, False, False, False]),
    ):
        given = outputs(bake(model(tail), line("temperature", 0.5), "heatmap", kind), x)[0]  # type: ignore[arg-type]
        assert (~np.isfinite(given)).ravel().tolist() == refused


def test_logits_that_the_graph_itself_uses_stay_for_it() -> None:
    """ "logits" is an output and feeds the Sigmoid: only the output is corrected."""
    heatmap, logits = outputs(bake(model(["Sigmoid"]), line("temperature", 0.5), "logits", "logits"), X)
    np.testing.assert_allclose(logits, X, atol=1e-6)
    np.testing.assert_allclose(heatmap, sigmoid(2.0 * X.astype(np.float64)), atol=1e-6)


def test_a_model_can_be_calibrated_again() -> None:
    once = bake(model(["Sigmoid"]), line("temperature", 0.5), "heatmap", "probability")
    twice = bake(once, line("scale and bias", 3.0, 1.0), "heatmap", "probability")
    np.testing.assert_allclose(outputs(twice, X)[0], sigmoid(3.0 * X.astype(np.float64) + 1.0), atol=1e-6)


def test_a_model_whose_correction_was_cut_off_can_be_calibrated() -> None:
    """Its nodes are gone and its numbers are not, as where somebody moves the output back to the logits."""
    once = bake(model(["Sigmoid"]), line("temperature", 0.5), "heatmap", "probability")
    left = [node for node in once.graph.node if not node.name.startswith(PREFIX)]
    left[-1].input[0] = "logits"
    del once.graph.node[:]
    once.graph.node.extend(left)
    again = bake(once, line("temperature", 3.0), "heatmap", "probability")
    np.testing.assert_allclose(outputs(again, X)[0], sigmoid(6.0 * X.astype(np.float64)), atol=1e-6)


def test_a_graph_that_a_runtime_takes_and_onnx_does_not_is_said() -> None:
    made = model(["Sigmoid"])
    nodes = list(made.graph.node)
    del made.graph.node[:]
    made.graph.node.extend(reversed(nodes))
    outputs(made, X)
    with pytest.raises(DetectorError, match=r"no valid ONNX.* topologically sorted.*export it again"):
        bake(made, line("temperature", 0.5), "heatmap", "probability")


def test_numpy_agrees_with_the_graph_on_the_heatmap_of_the_old_model() -> None:
    before, _ = outputs(model(["Sigmoid"]), X)
    after, _ = outputs(bake(model(["Sigmoid"]), CURVE, "heatmap", "probability"), X)
    np.testing.assert_allclose(CURVE.probability(before), after, atol=1e-3)


def test_half_precision_stays_half_precision() -> None:
    baked = bake(
        model(["Sigmoid"], dtype=TensorProto.FLOAT16), line("temperature", 0.5), "heatmap", "probability"
    )
    heatmap, _ = outputs(baked, X.astype(np.float16))
    assert heatmap.dtype == np.float16
    np.testing.assert_allclose(heatmap, sigmoid(X.astype(np.float64)), atol=2e-3)


@pytest.mark.parametrize(
    ("made", "output", "kind", "message"),
    [
        (model(["Sigmoid"]), "map", "probability", "no output 'map'; it has heatmap, logits"),
        (model(["Pow"]), "heatmap", "probability", "made by Pow, not Sigmoid"),
        (model(["Sigmoid"], opset=7), "heatmap", "probability", "operator set is 7; a calibration needs 8"),
    ],
)
def test_what_cannot_be_baked_is_said(made: onnx.ModelProto, output: str, kind: str, message: str) -> None:
    with pytest.raises(DetectorError, match=message):
        bake(made, line("temperature", 0.5), output, kind)  # type: ignore[arg-type]


def test_only_the_contract_in_the_metadata_changes() -> None:
    made = model(["Sigmoid"])
    write_contract(made, {"name": "first"})
    write_contract(made, {"name": "zweites Gerät"})
    entries = [(entry.key, entry.value) for entry in made.metadata_props]
    assert entries[0] == ("author", "somebody") and len(entries) == 2
    assert entries[1][0] == "crowdfence" and json.loads(entries[1][1]) == {"name": "zweites Gerät"}
