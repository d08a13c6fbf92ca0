"""What the agents' action heads can and cannot see, and how their memory is fed."""

import pytest
import torch as th
from sb3_contrib.common.recurrent.policies import RecurrentActorCriticPolicy
from sb3_contrib.common.recurrent.type_aliases import RNNStates
from torch import nn

from sb3_guide.policies import (
    GuidedLearnerPolicy,
    GuidePolicy,
    LearnerPolicy,
    PretrainedGuide,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
    save_agent,
)
from sb3_guide.policies.film import FiLM, FiLMExtractor
from sb3_guide.policies.interventions import Scene
from sb3_guide.policies.networks import Latent
from sb3_guide.policies.sequences import Sequences, distinct, windows
from tests.policies.helpers import HISTORY, make_policy, random_images, random_missions

RECURRENT = [RecurrentLearnerPolicy, RecurrentGuidePolicy, RecurrentGuidedLearnerPolicy]
PAIRS = [(LearnerPolicy, RecurrentLearnerPolicy), (GuidePolicy, RecurrentGuidePolicy)]


def action_log_probs(policy, obs):
    return policy.get_distribution(obs).distribution.logits.log_softmax(dim=-1)


@pytest.mark.parametrize("size", ["compact", "medium", "paper"])
def test_the_guides_actions_are_a_function_of_its_message_alone(window, size):
    policy = make_policy(GuidePolicy, size=size)
    with th.no_grad():
        memory = policy.memory(window)
        message = policy.channel.encoder.shape.index(policy.channel.speak(memory).argmax(dim=-1))
        of_message = policy.listen(memory[:1])[0]  # (M, A)
        assert th.allclose(action_log_probs(policy, window), of_message[message], atol=1e-6)
        assert th.allclose(policy.listen(memory), of_message.expand(4, 9, 7), atol=1e-6)


def test_the_guides_actions_are_a_function_of_its_numbers_alone(window, monkeypatch):
    policy = make_policy(GuidePolicy, channel="continuous")
    with th.no_grad():
        assert len(action_log_probs(policy, window).unique(dim=0)) == 4
        monkeypatch.setattr(policy.channel, "speak", lambda memory, generator=None: th.ones(len(memory), 2, 3))
        assert len(action_log_probs(policy, window).unique(dim=0)) == 1


def test_sb3_leaves_the_channels_initialisation_alone(window):
    policy = make_policy(GuidePolicy)
    with th.no_grad():
        assert th.allclose(policy.message_log_probs(window).exp(), th.tensor(1 / 9), atol=1e-6)


@pytest.mark.parametrize("policy_class", [LearnerPolicy, GuidePolicy, *RECURRENT])
def test_all_agents_begin_alike_and_sb3_initialises_none_anew(policy_class):
    guided = {"guide": PretrainedGuide.untrained()} if policy_class is RecurrentGuidedLearnerPolicy else {}
    policy = make_policy(policy_class, **guided)
    films = [module for module in policy.modules() if isinstance(module, FiLM)]
    assert films
    assert all((film.gamma.bias == 1).all() for film in films)
    assert policy.action_net.weight.std() > 0.05  # SB3's own is at a hundredth of its size
    assert not policy.ortho_init


def test_sb3s_orthogonal_initialisation_may_be_had():
    policy = make_policy(LearnerPolicy, ortho_init=True)
    assert all((module.gamma.bias == 0).all() for module in policy.modules() if isinstance(module, FiLM))
    assert policy.action_net.weight.std() < 0.005


@pytest.mark.parametrize("channel", ["discrete", "continuous"])
def test_no_gradient_reaches_the_guides_memory_but_through_the_message(window, monkeypatch, channel):
    policy = make_policy(GuidePolicy, channel=channel)
    speak = policy.channel.speak
    monkeypatch.setattr(policy.channel, "speak", lambda memory, generator=None: speak(memory, generator).detach())
    action_log_probs(policy, window)[:, 0].sum().backward()
    assert all(weight.grad is None for weight in policy.channel.speaker.parameters())
    assert any(weight.grad is not None for weight in policy.channel.encoder.parameters())


def test_a_guide_that_explores_draws_messages_from_its_memory_whatever_its_critic_reads():
    policy, scene = make_policy(GuidePolicy), Scene(th.arange(5), lambda: memory)
    memory = th.randn(5, policy.network.state_size)
    nn.init.normal_(policy.network.speaker.decoder.logits.weight)  # else all messages are equally probable
    latent = policy.network.latent(memory, scene)
    modest = Latent(memory, vf=latent.pi, listen=lambda: latent.pi)
    expected, found = (policy.exploring_distribution(each).distribution.logits for each in (latent, modest))
    assert th.equal(expected, found)
    assert not th.allclose(expected[0], expected[1])


def test_the_guided_learner_sees_its_own_memory_too(window, tmp_path):
    save_agent(make_policy(GuidePolicy), tmp_path)
    policy = make_policy(GuidedLearnerPolicy, guide=tmp_path)
    with th.no_grad():
        listened = policy.listen(policy.memory(window))
        assert not th.allclose(listened[0], listened[1], atol=1e-4)
        message = policy.channel.encoder.shape.index(policy.channel.speak(policy.memory(window)).argmax(dim=-1))
        assert th.allclose(action_log_probs(policy, window), listened[th.arange(4), message], atol=1e-6)


@pytest.mark.parametrize(("window_class", "carried_class"), PAIRS)
def test_a_window_as_long_as_the_episode_equals_carried_memory(window_class, carried_class):
    in_window, carried = make_policy(window_class, history=5), make_policy(carried_class)
    carried.load_state_dict(in_window.state_dict())
    images, mission = random_images(6, 2), random_missions(2)  # 6 steps in 2 worlds
    history, state = (
        th.zeros(2, 5, 7, 7, 3, dtype=th.uint8),
        tuple(th.zeros(1, 2, carried.network.state_size) for _ in range(2)),
    )
    with th.no_grad():
        for step, image in enumerate(images):
            distribution, state = carried.get_distribution(
                {"image": image, "mission": mission}, state, th.full((2,), float(step == 0))
            )
            expected = action_log_probs(in_window, {"image": image, "mission": mission, "history": history})
            assert th.allclose(distribution.distribution.logits.log_softmax(dim=-1), expected, atol=1e-5)
            history = th.cat([history[:, 1:], image.unsqueeze(1)], dim=1)


@pytest.mark.parametrize("carried_class", [RecurrentLearnerPolicy, RecurrentGuidePolicy, RecurrentGuidedLearnerPolicy])
def test_padded_sequences_equal_single_steps(carried_class, tmp_path):
    save_agent(make_policy(RecurrentGuidePolicy), tmp_path)
    guide = {"guide": tmp_path} if carried_class is RecurrentGuidedLearnerPolicy else {}
    policy = make_policy(carried_class, **guide)
    size, steps = policy.network.state_size, 4
    images, mission = random_images(2, steps), random_missions(2)
    missions = mission.repeat_interleave(steps, dim=0)
    images[1, 2:] = missions[steps + 2 :] = 0  # the second sequence has two steps, RecurrentPPO pads the others with zeros
    start = tuple(th.randn(1, 2, size) for _ in range(2))
    starts = th.zeros(2, steps)
    starts[1, 0] = 1.0
    actions = th.arange(8) % 7
    with th.no_grad():
        obs = {"image": images.flatten(0, 1), "mission": missions}
        values, log_prob, entropy = policy.evaluate_actions(obs, actions, RNNStates(start, start), starts.flatten())
        for part in (values, log_prob, entropy):
            assert not part[-2:].any()
        state = start
        for step in range(steps):
            worlds = 1 if step >= 2 else 2
            obs = {"image": images[:worlds, step], "mission": mission[:worlds]}
            state = tuple(part[:, :worlds].contiguous() for part in state)
            value = policy.predict_values(obs, state, starts[:worlds, step])
            latent, state = policy._step(obs, state, starts[:worlds, step])
            distribution = policy.exploring_distribution(latent)
            row = th.arange(worlds) * steps + step
            assert th.allclose(values[row], value, atol=1e-5)
            assert th.allclose(log_prob[row], distribution.log_prob(actions[row]), atol=1e-5)
            assert th.allclose(entropy[row], distribution.entropy(), atol=1e-5)


def test_carried_memory_equals_sb3_contribs_loop_over_time():
    policy, n_seq, steps = make_policy(RecurrentLearnerPolicy), 3, 5
    obs = {"image": random_images(n_seq * steps), "mission": random_missions(n_seq).repeat_interleave(steps, dim=0)}
    state = tuple(th.randn(1, n_seq, policy.network.state_size) for _ in range(2))
    starts = th.zeros(n_seq, steps)
    starts[1, 0] = 1.0
    lstm = th.nn.LSTM(policy.network.film.features_dim, policy.network.state_size)
    lstm.load_state_dict(policy.network.memory.lstm.state_dict())
    with th.no_grad():
        features = policy.network.film(obs)
        expected, after = RecurrentActorCriticPolicy._process_sequence(features, state, starts.flatten(), lstm)
        latent, _ = policy._carry(obs, state, starts.flatten())
        for step in range(steps):
            row = th.arange(n_seq) * steps + step
            _, state = policy._step({name: part[row] for name, part in obs.items()}, state, starts[:, step])
    assert th.allclose(latent.pi, expected, atol=1e-5)
    for own, theirs in zip(state, after, strict=True):
        assert th.allclose(own, theirs, atol=1e-5)


def test_sequences_do_not_depend_on_their_batch_mates():
    network = make_policy(RecurrentGuidePolicy).network
    images, missions, lengths = random_images(9), random_missions(3), th.tensor([2, 4, 3])
    with th.no_grad():
        together = network.remember(Sequences(images, missions, lengths))
        for row, part in enumerate(images.split(lengths.tolist())):
            alone = network.remember(Sequences(part, missions[row : row + 1], lengths[row : row + 1]))
            assert th.allclose(together.split(lengths.tolist())[row], alone, atol=1e-5)


def test_a_windows_frames_before_the_episode_are_left_out(window):
    sequences = windows(window).sequences()
    assert sequences.lengths.tolist() == [1, 2, 3, 4]
    assert th.equal(sequences.images[sequences.lengths.cumsum(0) - 1], window["image"])
    assert th.equal(sequences.images[3:5], window["history"][2, HISTORY - 2 :])


def test_distinct_rows_are_each_represented_once():
    rows = th.tensor([[1, 2], [3, 4], [1, 2], [2, 1], [3, 4]], dtype=th.uint8)
    first, inverse = distinct(rows)
    assert len(first) == 3
    assert th.equal(rows[first][inverse], rows)
    assert all(map(th.equal, distinct(rows[:, :1].float(), rows[:, 1:].long()), (first, inverse)))


def test_rows_whose_parts_differ_are_distinct_however_large_their_numbers():
    looks, numbers = th.zeros(3, 4), th.tensor([[2**24], [2**24 + 1], [2**24]])  # which are one number as 32-bit floats
    assert th.equal(distinct(looks, numbers)[1].bincount().sort().values, th.tensor([1, 2]))


def test_missions_may_repeat_and_padding_is_not_read():
    extractor = make_policy(LearnerPolicy).network.film
    image, mission = random_images(2), random_missions(1).expand(2, -1)
    with th.no_grad():
        both = extractor({"image": image, "mission": mission})
        assert th.allclose(both[:1], extractor({"image": image[:1], "mission": mission[:1]}), atol=1e-6)


def test_parameters_of_the_papers_size_are_those_of_the_authors_code():
    """20.5 M for the Learner and 35.8 M for the Guide there, which has batch normalisation and no critic in cloning."""
    counts = [
        sum(weight.numel() for weight in make_policy(policy, size="paper").parameters())
        for policy in (LearnerPolicy, GuidePolicy)
    ]
    assert counts == pytest.approx([20.5e6, 35.8e6], rel=0.01)


def test_the_extractor_serves_sb3s_own_policies(window):
    from gymnasium import spaces
    from stable_baselines3.ppo import MultiInputPolicy

    from sb3_guide.envs import observation_space

    policy = MultiInputPolicy(
        observation_space(HISTORY), spaces.Discrete(7), lambda _: 1e-3, features_extractor_class=FiLMExtractor
    )
    assert policy(window)[0].shape == (4,)
