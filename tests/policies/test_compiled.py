"""A few worlds are played by compiled code, which gives what torch gives, whatever becomes of the weights."""

import copy
import pickle
from concurrent.futures import ThreadPoolExecutor
from unittest.mock import patch

import numpy as np
import pytest
import torch as th
from hypothesis import given
from hypothesis import strategies as st
from torch import nn
from torch.nn.utils import parametrize

from sb3_guide.policies import (
    GuidedLearnerPolicy,
    GuidePolicy,
    LearnerPolicy,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
    save_agent,
)
from sb3_guide.policies.compiled import FEW_WORLDS, remember_few, say
from sb3_guide.policies.rows import distinct_rows, number_cells
from sb3_guide.policies.sequences import frames, windows
from sb3_guide.policies.short_sequences import WindowsLSTM, WordsGRU
from tests.policies.helpers import HISTORY, make_policy, random_images, random_missions

WINDOW = (LearnerPolicy, GuidePolicy, GuidedLearnerPolicy)
CARRIED = (RecurrentLearnerPolicy, RecurrentGuidePolicy, RecurrentGuidedLearnerPolicy)
REMEMBER = "sb3_guide.policies.networks.remember_few"


def policy_of(policy_class, folder, **kwargs):
    """A policy whose weights, the messages' too, are such that everything they do shows."""
    if "GuidedLearner" in policy_class.__name__:
        guide = CARRIED[1] if policy_class.carries_memory else WINDOW[1]
        save_agent(make_policy(guide, **kwargs), folder)
        kwargs = {"guide": folder}
    policy = make_policy(policy_class, **kwargs)
    generator = th.Generator().manual_seed(1)
    with th.no_grad():
        for weight in policy.parameters():
            weight += 0.1 * th.randn(weight.shape, generator=generator)
    return policy


def observe(n_worlds, seed=0):
    """Observations of worlds, of which the first have just begun and the later ones have blank frames inside."""
    history = random_images(n_worlds, HISTORY, seed=seed)
    for world in range(n_worlds):
        history[world, : max(0, HISTORY - world)] = 0
    if n_worlds > 4:
        history[4, 1] = 0
    return {"image": random_images(n_worlds, seed=seed + 1), "mission": random_missions(n_worlds, seed), "history": history}


def by_torch(compute):
    """What torch computes, in the way that gradients go."""
    with th.enable_grad():
        return compute().detach()


def log_probs(policy, obs):
    """Of the actions, greedily and exploring, and the values."""
    latent = policy.network(obs)
    logits = [each(latent).distribution.logits for each in (policy.action_distribution, policy.exploring_distribution)]
    return th.cat([*logits, policy.value_net(policy.mlp_extractor.forward_critic(latent))], dim=1)


@pytest.mark.parametrize("n_worlds", [1, 2, FEW_WORLDS])
@pytest.mark.parametrize(("size", "channel"), [("compact", "discrete"), ("medium", "discrete"), ("compact", "continuous")])
@pytest.mark.parametrize("policy_class", WINDOW)
def test_windows_are_remembered_as_by_torch(policy_class, size, channel, n_worlds, tmp_path):
    form = {} if policy_class is LearnerPolicy else {"channel": channel}
    policy, obs = policy_of(policy_class, tmp_path, size=size, **form), observe(n_worlds)
    expected = by_torch(lambda: log_probs(policy, obs))
    with th.no_grad(), patch(REMEMBER, wraps=remember_few) as compiled:
        assert th.allclose(log_probs(policy, obs), expected, atol=1e-6 * max(1.0, float(expected.abs().max())))
    assert compiled.called


@pytest.mark.parametrize("policy_class", CARRIED)
def test_states_are_carried_as_by_torch(policy_class, tmp_path):
    policy, obs = policy_of(policy_class, tmp_path), observe(3)
    obs = {name: obs[name] for name in ("image", "mission")}
    start = tuple(0.3 * th.randn(1, 3, policy.network.state_size, generator=th.Generator().manual_seed(2)) for _ in range(2))
    starts = th.tensor([0.0, 1.0, 0.0])

    def step():
        latent, state = policy._step(obs, start, starts)
        return latent.pi, *state

    expected = step()
    with th.no_grad():
        found = step()
    for one, other in zip(found, expected, strict=True):
        assert th.allclose(one, other, atol=1e-6)


@pytest.mark.parametrize(("message_length", "vocabulary_size"), [(1, 4), (2, 3), (4, 2)])
def test_messages_are_as_probable_as_by_torch(message_length, vocabulary_size, tmp_path):
    policy = policy_of(GuidePolicy, tmp_path, message_length=message_length, vocabulary_size=vocabulary_size)
    memory = th.randn(5, policy.network.state_size, generator=th.Generator().manual_seed(0))
    for compute in (
        policy.channel.message_log_probs,
        policy.channel.speak,
        lambda memory: policy.channel.encoder(policy.channel.speak(memory).detach()),
        lambda memory: policy.channel.encoder.all(),
    ):
        expected = by_torch(lambda compute=compute: compute(memory))
        with th.no_grad():
            assert th.allclose(compute(memory), expected, atol=1e-6)


@th.no_grad()
def change_in_place(film):
    film.instruction.gru.weight_hh_l0.mul_(2.0)


def change_through_data(film):
    film.vision.convolution.weight.data[3] = 0.5


def change_through_numpy(film):
    film.vision.mix.weight.detach().numpy()[:] *= -1


def change_by_new_data(film):
    film.vision.out.weight.data = film.vision.out.weight.data.t().contiguous() + 0.1


def change_to_a_view(film):
    film.vision.out.weight.data = film.vision.out.weight.data.t()  # at the same address


def change_by_a_new_parameter(film):
    film.vision.film_view.gamma.bias = nn.Parameter(th.full_like(film.vision.film_view.gamma.bias, 0.7))


def change_by_a_new_module(film):
    film.vision.mix = nn.Linear(*reversed(film.vision.mix.weight.shape))


def change_by_a_hook(film):
    film.vision.register_forward_hook(lambda module, inputs, output: output + 1.0)


def change_by_parametrization(film):
    class Twice(nn.Module):
        def forward(self, weight):
            return 2 * weight

    parametrize.register_parametrization(film.vision.convolution, "weight", Twice())


@pytest.mark.parametrize(
    "change",
    [
        change_in_place,
        change_through_data,
        change_through_numpy,
        change_by_new_data,
        change_to_a_view,
        change_by_a_new_parameter,
        change_by_a_new_module,
        change_by_a_hook,
        change_by_parametrization,
    ],
)
def test_every_change_of_weights_shows_at_once(change, tmp_path):
    policy, obs = policy_of(LearnerPolicy, tmp_path), observe(2)
    with th.no_grad():
        before = log_probs(policy, obs)
        change(policy.network.film)
        after = log_probs(policy, obs)
    assert not th.allclose(after, before, atol=1e-4)
    assert th.allclose(after, by_torch(lambda: log_probs(policy, obs)), atol=1e-5)


def change_by_a_class_of_ones_own(film):
    class Adapted(nn.Linear):
        def forward(self, x):
            return super().forward(x) + 1.0

    adapted = Adapted(*reversed(film.vision.mix.weight.shape))
    adapted.load_state_dict(film.vision.mix.state_dict())
    film.vision.mix = adapted


def change_of_the_normalisation(film):
    film.vision.normalise = nn.Identity()


@pytest.mark.parametrize("change", [change_by_a_class_of_ones_own, change_of_the_normalisation])
def test_modules_of_ones_own_are_called(change, tmp_path):
    policy, obs = policy_of(LearnerPolicy, tmp_path), observe(2)
    with th.no_grad():
        log_probs(policy, obs)
        change(policy.network.film)
        after = log_probs(policy, obs)
    assert th.allclose(after, by_torch(lambda: log_probs(policy, obs)), atol=1e-5)


def test_loaded_and_doubled_weights_are_those_that_are_used(tmp_path):
    policy, obs = policy_of(GuidePolicy, tmp_path), observe(1)
    other = make_policy(GuidePolicy)
    with th.no_grad():
        expected = log_probs(policy, obs)
        log_probs(other, obs)
        other.load_state_dict(policy.state_dict())
        assert th.equal(log_probs(other, obs), expected)
        twin = copy.deepcopy(policy)
        policy.network.speaker.film.vision.out.weight.mul_(0.5)
        assert th.equal(log_probs(twin, obs), expected)
        assert th.equal(log_probs(pickle.loads(pickle.dumps(twin)), obs), expected)
        double = copy.deepcopy(twin).double()
        assert th.allclose(double.network(obs).memory, twin.network(obs).memory.double(), atol=1e-6)


def test_threads_and_policies_do_not_meet(tmp_path):
    policies = [policy_of(GuidePolicy, tmp_path) for _ in range(2)]
    with th.no_grad():
        policies[1].network.speaker.film.vision.out.weight.mul_(0.5)

    def remember(task):
        policy, seed = task
        with th.no_grad():
            memory = policy.network(observe(1, seed)).memory
            return th.cat([memory, policy.channel.message_log_probs(memory)], dim=1)

    tasks = [(policy, seed) for policy in policies for seed in range(8)]
    expected = list(map(remember, tasks))
    with ThreadPoolExecutor(8) as pool:
        assert all(map(th.equal, pool.map(remember, 20 * tasks), 20 * expected))


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [("image", 11, "cells of images have values from 0 to 11"), ("mission", 200, "missions have values from 0 to 200")],
)
def test_what_is_unknown_is_an_error_with_its_name(name, value, message, tmp_path):
    policy, obs = policy_of(LearnerPolicy, tmp_path), observe(1)
    obs[name].view(-1)[0] = value
    with th.no_grad(), pytest.raises(ValueError, match=message):
        policy(obs)


@pytest.mark.parametrize(
    ("rows", "width"), [(1, 64), (3, 64), (2, 61), (2, 67)], ids=["too few", "too many", "too narrow", "too wide"]
)
def test_states_of_another_shape_are_refused(rows, width):
    policy, obs = make_policy(RecurrentLearnerPolicy), observe(2)
    with th.no_grad(), pytest.raises(RuntimeError, match=r"hidden|hx|size"):
        policy.network.step(frames(obs), (th.zeros(1, rows, width), th.zeros(1, rows, width)))


@pytest.mark.parametrize("shape", [(9, 9, 3), (5, 7, 3), (7, 7, 2), (7, 7, 4)])
@pytest.mark.parametrize("gradients", [False, True])
def test_images_of_another_shape_are_refused(shape, gradients):
    policy, obs = make_policy(LearnerPolicy, history=0), observe(2)
    with th.set_grad_enabled(gradients), pytest.raises(RuntimeError, match="shape"):
        policy.network({"image": th.ones(2, *shape, dtype=th.uint8), "mission": obs["mission"]})


@pytest.mark.parametrize("n_missions", [1, 3])
def test_as_many_missions_as_worlds_are_needed(n_missions):
    policy, obs = make_policy(LearnerPolicy), observe(2)
    with th.no_grad(), pytest.raises(RuntimeError, match="size"):
        policy.network({**obs, "mission": random_missions(n_missions)})


def test_messages_of_other_widths_are_refused():
    channel = make_policy(GuidePolicy).channel
    with th.no_grad():
        with pytest.raises(RuntimeError, match="shape"):
            channel.speak(th.randn(2, 69))
        with pytest.raises(RuntimeError, match="shape"):
            channel.encoder(th.ones(2, 2, 7))


@pytest.mark.parametrize("policy_class", [GuidePolicy, GuidedLearnerPolicy])
@pytest.mark.parametrize("n_worlds", [1, 2, FEW_WORLDS])
def test_the_messages_of_a_few_worlds_are_compiled(policy_class, n_worlds, tmp_path):
    policy, obs = policy_of(policy_class, tmp_path), observe(n_worlds)
    with th.no_grad(), patch("sb3_guide.policies.compiled.say", wraps=say) as compiled:
        policy.predict({name: part.numpy() for name, part in obs.items()}, deterministic=True)
    assert compiled.called


@pytest.mark.parametrize("n_worlds", [2, 40])
def test_autocast_is_torchs(n_worlds):
    policy, obs = make_policy(LearnerPolicy), observe(n_worlds)
    with th.autocast("cpu", dtype=th.bfloat16), th.no_grad():
        close = policy.network(obs).memory
    with th.no_grad():
        assert th.allclose(close.float(), policy.network(obs).memory, atol=0.1)
    carried = make_policy(RecurrentLearnerPolicy)
    state = tuple(th.zeros(1, n_worlds, carried.network.state_size) for _ in range(2))
    with th.autocast("cpu", dtype=th.bfloat16):
        carried.network.step(frames(obs), state)


def test_training_follows_metrics_in_inference_mode():
    encoder = make_policy(GuidePolicy, message_length=3, vocabulary_size=4).channel.encoder  # a form of its own
    with th.inference_mode():
        encoder.all()
    encoder.all().sum().backward()
    assert encoder.gru.weight_hh_l0.grad is not None


def test_saliency_of_images_is_possible():
    policy, obs = make_policy(LearnerPolicy), observe(2)
    image = obs["image"].float().requires_grad_()
    assert policy.network({**obs, "image": image}).memory.shape == (2, 64)


def test_what_is_no_number_stays_none(tmp_path):
    policy, obs = policy_of(LearnerPolicy, tmp_path), observe(1)
    with th.no_grad():
        policy.network.film.vision.film_cells.gamma.bias[0] = float("nan")
        assert policy.network(obs).memory.isnan().all()


@given(rows=st.lists(st.lists(st.integers(-2, 2), min_size=3, max_size=3), min_size=1, max_size=40))
def test_equal_rows_are_found(rows):
    array = np.array(rows)
    first, position = distinct_rows(array[:, :2].copy(), array[:, 2:].copy())
    assert len({tuple(row) for row in rows}) == len(first)
    assert (array[first][position] == array).all()


@pytest.mark.parametrize("dtype", [np.uint8, np.float32])
def test_cells_are_numbered_by_hand(dtype):
    cells, numbers = np.array([[2, 0, 1], [0, 3, 1]], dtype), np.empty(2, np.int64)
    assert number_cells(cells, np.array([3, 4, 2]), numbers)
    assert numbers.tolist() == [2 * 8 + 0 * 2 + 1, 0 * 8 + 3 * 2 + 1]
    assert not number_cells(cells, np.array([3, 3, 2]), numbers)
    assert not number_cells(np.array([[0.5, 0, 0]], np.float32), np.array([3, 3, 2]), numbers)


def doubles(*shape, seed=0):
    return th.randn(shape, dtype=th.float64, generator=th.Generator().manual_seed(seed)).requires_grad_()


def test_gradients_of_the_words_gru():
    is_word = th.tensor([[True, True], [True, False], [False, True]]).unsqueeze(2)
    inputs = (doubles(3, 2, 9), is_word, doubles(9, 3, seed=1), doubles(9, seed=2))
    assert th.autograd.gradcheck(WordsGRU.apply, inputs)


def test_gradients_of_the_windows_lstm():
    began = th.tensor([[False, True], [True, True], [True, True]]).unsqueeze(2)

    def remember(inputs, weight):
        return WindowsLSTM.apply(inputs.masked_fill(~began, -th.inf), weight)

    assert th.autograd.gradcheck(remember, (doubles(3, 2, 12), doubles(12, 3, seed=1)))


def test_a_few_short_windows_are_remembered_as_many_are():
    policy, obs = make_policy(LearnerPolicy), observe(6)
    few = policy.network.look_back(windows(obs))
    with patch("sb3_guide.policies.networks.FEW_FRAMES", 0):
        many = policy.network.look_back(windows(obs))
    assert th.allclose(few, many, atol=1e-6)
    for one, other in zip(
        *(th.autograd.grad(each.sum(), list(policy.network.parameters())) for each in (few, many)), strict=True
    ):
        assert th.allclose(one, other, atol=1e-5)


def test_few_and_many_missions_are_read_alike():
    encoder, missions = make_policy(LearnerPolicy).network.film.instruction, random_missions(30).long()
    missions[0], missions[1, 1] = 0, 0  # an empty one, and padding between words
    few = encoder(missions)
    with patch("sb3_guide.policies.film.FEW_WORDS", 0):
        many = encoder(missions)
    assert th.allclose(few, many, atol=1e-6)
    for one, other in zip(*(th.autograd.grad(each.sum(), list(encoder.parameters())) for each in (few, many)), strict=True):
        assert th.allclose(one, other, atol=1e-5)
