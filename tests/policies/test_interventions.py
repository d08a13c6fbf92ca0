"""What is left of a message after each intervention, on hand-made cases and in agents."""

import pytest
import torch as th
import torch.nn.functional as F

from sb3_guide.policies import (
    GuidedLearnerPolicy,
    GuidePolicy,
    PretrainedGuide,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    load_agent,
    save_agent,
)
from sb3_guide.policies.interventions import (
    Chosen,
    Delayed,
    Intervention,
    Marginal,
    Scene,
    Shuffled,
    Silent,
    Swapped,
    Uniform,
    intervention_of,
)
from sb3_guide.policies.memory import scene_of
from tests.policies.helpers import make_policy, random_images, random_missions

SPOKEN = th.tensor([[0, 1], [1, 1], [2, 0], [2, 2], [0, 0]])
EPISODE = th.tensor([0, 0, 0, 1, 1])


def hear(intervention: Intervention, spoken: th.Tensor = SPOKEN, episode: th.Tensor = EPISODE, seed: int = 0) -> th.Tensor:
    """Symbols that are heard."""
    scene = Scene(episode, lambda: pytest.fail("no message of the frame before was asked for"))
    heard = intervention(F.one_hot(spoken, 3).float(), scene, th.Generator().manual_seed(seed))
    assert th.equal(heard.sum(dim=-1), th.ones(spoken.shape))
    return heard.argmax(dim=-1)


def frequencies(symbols: th.Tensor) -> list[float]:
    return ((symbols[:, 0] * 3 + symbols[:, 1]).bincount(minlength=9) / len(symbols)).tolist()


def test_as_spoken():
    assert th.equal(hear(Intervention()), SPOKEN)


def test_silence_is_always_the_same():
    assert hear(Silent()).tolist() == [[0, 0]] * 5


def test_uniform_messages_are_equally_probable():
    heard = hear(Uniform(), SPOKEN.repeat(4000, 1), EPISODE.repeat(4000))
    assert frequencies(heard) == pytest.approx([1 / 9] * 9, abs=0.01)


def test_marginal_messages_follow_the_probabilities():
    probabilities = (0.5, 0, 0, 0, 0.25, 0, 0, 0, 0.25)
    heard = hear(Marginal(probabilities), SPOKEN.repeat(4000, 1), EPISODE.repeat(4000))
    assert frequencies(heard) == pytest.approx(probabilities, abs=0.015)


def test_shuffled_messages_come_from_other_episodes_all_of_them_equally_often():
    own = th.tensor([[0, 0]] * 3 + [[1, 1]] * 2 + [[2, 2]])
    heard = th.stack([hear(Shuffled(), own, th.tensor([4, 4, 4, 7, 7, 1]), seed) for seed in range(2000)])[..., 0]
    for frame, (first, second, third) in enumerate([(0, 2 / 3, 1 / 3)] * 3 + [(3 / 4, 0, 1 / 4)] * 2 + [(3 / 5, 2 / 5, 0)]):
        share = heard[:, frame].bincount(minlength=3) / 2000
        assert share.tolist() == pytest.approx([first, second, third], abs=0.04)


def test_where_nobody_else_speaks_shuffled_messages_are_uniform():
    heard = hear(Shuffled(), SPOKEN[:1].repeat(9000, 1), th.zeros(9000, dtype=th.long))
    assert frequencies(heard) == pytest.approx([1 / 9] * 9, abs=0.02)


def test_no_gradient_reaches_a_guide_whose_words_reach_somebody_else():
    spoken = F.one_hot(SPOKEN, 3).float().requires_grad_()
    assert not Shuffled()(spoken, Scene(EPISODE, th.Tensor), th.Generator()).requires_grad


@pytest.mark.parametrize("position", [0, 1])
def test_one_symbol_is_swapped_for_each_of_the_others(position):
    heard = hear(Swapped(position), SPOKEN.repeat(1000, 1), EPISODE.repeat(1000))
    said = SPOKEN.repeat(1000, 1)
    assert th.equal(heard[:, 1 - position], said[:, 1 - position])
    shift = (heard - said)[:, position] % 3
    assert shift.bincount(minlength=3).tolist() == pytest.approx([0, 2500, 2500], abs=150)


def test_a_chosen_message():
    assert hear(Chosen((2, 1))).tolist() == [[2, 1]] * 5


@pytest.mark.parametrize(
    ("intervention", "message"),
    [
        (Chosen((0,)), r"message \(0,\): expected 2 symbols from 0 to 2"),
        (Chosen((0, 3)), r"message \(0, 3\): expected 2 symbols from 0 to 2"),
        (Swapped(2), "position=2: expected 0 to 1"),
        (Marginal((0.5, 0.5)), "2 probabilities: expected one for each of 9 messages"),
    ],
)
def test_what_does_not_fit_the_channel(intervention, message):
    with pytest.raises(ValueError, match=message):
        hear(intervention)


def test_an_unknown_name():
    with pytest.raises(ValueError, match="intervention 'loud' is unknown: expected one of spoken, silent, uniform"):
        intervention_of("loud")


@pytest.fixture
def guided(tmp_path) -> RecurrentGuidedLearnerPolicy:
    save_agent(talkative(RecurrentGuidePolicy), tmp_path / "guide")
    return make_policy(RecurrentGuidedLearnerPolicy, guide=tmp_path / "guide")


def talkative(policy_class, **kwargs):
    """A policy whose messages depend on what it sees."""
    policy = make_policy(policy_class, **kwargs)
    th.manual_seed(1)
    th.nn.init.normal_(policy.channel.speaker.decoder.logits.weight)
    return policy


def log_probs_of_two_episodes(policy):
    """Action log-probabilities at 5 frames, of 3 and 2, and the frames' scene."""
    network, lengths = policy.network, th.tensor([3, 2])
    from sb3_guide.policies.sequences import Sequences

    with th.no_grad():
        memory = network.remember(Sequences(random_images(5), random_missions(2), lengths))
        scene = scene_of(memory, lengths)
        return policy.action_distribution(network.latent(memory, scene)).distribution.logits, memory, scene


@pytest.mark.parametrize("intervention", [Silent(), Uniform(), Chosen((1, 2)), Marginal((1 / 9,) * 9)])
def test_nothing_leaks_through_an_intervention_that_replaces_the_message(guided, intervention):
    with guided.hearing(intervention):
        before, _, _ = log_probs_of_two_episodes(guided)
        guided.channel.chance.manual_seed(0)
        for weight in guided.channel.speaker.parameters():
            th.nn.init.normal_(weight)
        after, _, _ = log_probs_of_two_episodes(guided)
    assert th.equal(before, after)
    with guided.hearing(Chosen((2, 0))):
        assert not th.allclose(before, log_probs_of_two_episodes(guided)[0])  # while messages do matter


def test_a_delayed_message_is_that_of_the_frame_before(guided):
    _, memory, scene = log_probs_of_two_episodes(guided)
    with th.no_grad(), guided.hearing(Delayed()):
        heard = guided.channel.hear(memory, scene)
        spoken = guided.channel.encoder(guided.channel.speak(memory))
        of_nothing = guided.channel.encoder(guided.channel.speak(th.zeros_like(memory)))[0]
    assert th.equal(heard[[1, 2, 4]], spoken[[0, 1, 3]])
    assert th.equal(heard[[0, 3]], of_nothing.expand(2, -1))


def test_delays_are_the_same_step_by_step_and_in_sequences(guided):
    images, missions = random_images(5), random_missions(2)
    with th.no_grad(), guided.hearing(Delayed()):
        together, _, _ = log_probs_of_two_episodes(guided)
        for episode, frames in enumerate(([0, 1, 2], [3, 4])):
            state = tuple(th.zeros(1, 1, guided.network.state_size) for _ in range(2))
            for step, frame in enumerate(frames):
                obs = {"image": images[[frame]], "mission": missions[[episode]]}
                distribution, state = guided.get_distribution(obs, state, th.full((1,), float(step == 0)))
                assert th.allclose(distribution.distribution.logits, together[[frame]], atol=1e-5)


def test_delays_in_a_window_are_those_of_carried_memory(window, tmp_path):
    save_agent(talkative(GuidePolicy), tmp_path)
    policy = make_policy(GuidedLearnerPolicy, guide=tmp_path)
    shorter = {"mission": window["mission"], "image": window["history"][:, -1], "history": window["history"].roll(1, dims=1)}
    shorter["history"][:, 0] = 0
    with th.no_grad():
        before = policy.channel.speak(policy.memory(shorter))
        with policy.hearing(Delayed()):
            heard = policy.channel(window).pi[:, policy.channel.parts[0] :]
    assert th.allclose(heard[1:], policy.channel.encoder(before)[1:], atol=1e-6)  # the first one has nothing before it


def test_an_agent_is_saved_with_what_it_hears_and_hears_it_again(tmp_path):
    guide = PretrainedGuide.untrained()
    save_agent(make_policy(RecurrentGuidedLearnerPolicy, guide=guide, hears="shuffled"), tmp_path)
    policy = load_agent(tmp_path)
    assert isinstance(policy.channel.intervention, Shuffled)
    with policy.hearing(Silent()):
        assert isinstance(policy.channel.intervention, Silent)
    assert isinstance(policy.channel.intervention, Shuffled)


def test_an_agent_without_a_channel_hears_nothing():
    from sb3_guide.policies import RecurrentLearnerPolicy

    with pytest.raises(ValueError, match="sends no messages"), make_policy(RecurrentLearnerPolicy).hearing(Silent()):
        pass


def test_a_reader_has_the_guides_words_and_another_way_of_reading_them(tmp_path):
    guide = talkative(RecurrentGuidePolicy)
    save_agent(guide, tmp_path)
    reader = make_policy(RecurrentGuidePolicy, guide=tmp_path, freeze_guide=True)
    for name, weight in reader.channel.speaker.named_parameters():
        assert th.equal(weight, guide.channel.speaker.get_parameter(name))
        assert not weight.requires_grad
    with pytest.raises(ValueError, match=r"the Guide has .*'message_length': 2.*: expected .*'message_length': 3"):
        make_policy(RecurrentGuidePolicy, guide=tmp_path, message_length=3)
    with pytest.raises(ValueError, match="can't hear a RecurrentGuidePolicy"):
        make_policy(GuidePolicy, guide=tmp_path)


@pytest.mark.parametrize("name", ["uniform", "shuffled", "swapped"])
def test_what_needs_symbols_has_no_meaning_without_them(name):
    numbers = PretrainedGuide.untrained(channel="continuous")
    with pytest.raises(ValueError, match=r"needs symbols, of which a continuous channel has none: expected .*silent, delayed"):
        make_policy(RecurrentGuidedLearnerPolicy, guide=numbers, hears=name)
    policy = make_policy(RecurrentGuidedLearnerPolicy, guide=numbers)
    for intervention in (intervention_of(name), Chosen((0, 1)), Marginal((1.0,))):
        with pytest.raises(ValueError, match="needs symbols"), policy.hearing(intervention):
            pass
    assert policy.channel.intervention == Intervention()


@pytest.mark.parametrize("name", ["silent", "delayed"])
def test_silence_and_delay_need_no_symbols(name):
    numbers = PretrainedGuide.untrained(channel="continuous")
    usual, changed = (
        log_probs_of_two_episodes(make_policy(RecurrentGuidedLearnerPolicy, guide=numbers, hears=hears))[0]
        for hears in ("spoken", name)
    )
    assert not th.allclose(usual, changed)
