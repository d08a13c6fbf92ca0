"""imitation's BC on whole episodes."""

import numpy as np
import pytest
import torch as th
from imitation.util.logger import HierarchicalLogger
from stable_baselines3.common.logger import Logger, TensorBoardOutputFormat
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from sb3_guide.callbacks import LanguagePictures
from sb3_guide.cloning.bc import EpisodeLoader, EpisodeLoss, episode_bc
from sb3_guide.policies import (
    LearnerPolicy,
    PretrainedGuide,
    RecurrentGuidedLearnerPolicy,
    RecurrentGuidePolicy,
    RecurrentLearnerPolicy,
    save_agent,
)
from sb3_guide.policies.memory import scene_of
from tests.cloning.helpers import make_demonstrations, make_episodes
from tests.policies.helpers import make_policy

SILENT = HierarchicalLogger(Logger(folder=None, output_formats=[]))
SETTINGS = {"batch_size": 2, "learning_rate": 1e-2, "ent_weight": 0.0, "logger": SILENT}


def as_tensors(batch):
    return {name: th.as_tensor(part) for name, part in batch["obs"].items()}, th.as_tensor(batch["acts"])


def test_a_row_is_an_episode():
    loader = EpisodeLoader(make_episodes([2, 4, 3]), batch_size=3, seed=0)
    (batch,) = list(loader)
    assert len(batch["obs"]) == len(batch["acts"]) == 3
    assert batch["obs"].get("image").shape == (3, 4, 7, 7, 3)
    assert sorted(batch["obs"].get("length")) == [2, 3, 4]
    padding = np.arange(4) >= batch["obs"].get("length")[:, None]
    assert not batch["obs"].get("image")[padding].any()


def test_the_order_is_a_function_of_seed_and_epoch():
    episodes = make_episodes([1] * 20)

    def order(seed: int, epoch: int) -> list[int]:
        loader = EpisodeLoader(episodes, 4, seed)
        loader.epoch = epoch
        return [int(mission[0]) for batch in loader for mission in batch["obs"].get("mission")]

    assert order(0, 1) == order(0, 1)
    assert order(0, 1) != order(0, 2)
    assert order(0, 1) != order(1, 1)


def test_each_epoch_has_an_order_of_its_own():
    loader = EpisodeLoader(make_episodes([1] * 11), batch_size=4, seed=0)
    epochs = [[tuple(mission) for batch in loader for mission in batch["obs"].get("mission")] for _ in range(5)]
    assert loader.epoch == len({tuple(epoch) for epoch in epochs}) == 5
    assert len({mission for epoch in epochs for mission in epoch}) == 11


def test_an_epoch_shows_no_episode_twice():
    episodes = make_episodes([1] * 11)
    shown = [tuple(mission) for batch in EpisodeLoader(episodes, 4, 0) for mission in batch["obs"].get("mission")]
    assert len(set(shown)) == len(shown) == 8


@pytest.mark.parametrize("batch_size", [0, 4])
def test_a_batch_needs_episodes(batch_size):
    with pytest.raises(ValueError, match=f"batch_size={batch_size}: expected 1 to 3, the number of demonstrations"):
        EpisodeLoader(make_episodes([1, 1, 1]), batch_size, 0)


@pytest.mark.parametrize("policy_class", [RecurrentLearnerPolicy, RecurrentGuidePolicy])
def test_the_loss_is_the_mean_over_frames_whatever_the_padding(policy_class):
    policy, episodes = make_policy(policy_class), make_episodes([5, 2])
    loss = EpisodeLoss(0.0, th.Generator().manual_seed(0), "float32")
    calculate = lambda part: loss(policy, *as_tensors(next(iter(EpisodeLoader(part, len(part), 0))))).neglogp.item()  # noqa: E731
    if policy_class is RecurrentGuidePolicy:  # greedy, so that the messages are the same in all three
        object.__setattr__(loss, "generator", None)
    together, long, short = (calculate(episodes.select(np.array(rows))) for rows in ([0, 1], [0], [1]))
    assert together == pytest.approx((5 * long + 2 * short) / 7, rel=1e-5)


def test_the_loss_carries_memory_through_the_episode():
    policy, episodes = make_policy(RecurrentLearnerPolicy), make_episodes([3])
    obs, acts = as_tensors(next(iter(EpisodeLoader(episodes, 1, 0))))
    by_hand, state = [], None
    with th.no_grad():
        for step in range(3):
            one = {"image": obs["image"][:, step], "mission": obs["mission"]}
            state = state or tuple(th.zeros(1, 1, policy.network.state_size) for _ in range(2))
            distribution, state = policy.get_distribution(one, state, th.zeros(1))
            by_hand.append(distribution.log_prob(acts[:, step]).item())
    assert EpisodeLoss(0.0, th.Generator(), "float32")(policy, obs, acts).neglogp.item() == pytest.approx(
        -np.mean(by_hand), rel=1e-5
    )


@pytest.mark.parametrize("policy_class", [RecurrentLearnerPolicy, RecurrentGuidePolicy, RecurrentGuidedLearnerPolicy])
def test_every_agent_learns_what_to_do_about_what_it_sees(policy_class, tmp_path):
    save_agent(make_policy(RecurrentGuidePolicy), tmp_path)
    guided = {"guide": PretrainedGuide.from_folder(tmp_path)} if policy_class is RecurrentGuidedLearnerPolicy else {}
    policy, demonstrations = make_policy(policy_class, **guided), make_demonstrations([3, 2, 4, 3] * 8)
    actions = demonstrations.episodes.actions
    actions[:] = 2 * (np.arange(len(actions)) % 2)
    demonstrations.episodes.images[:] = actions[:, None, None, None]  # all cells show what to do
    demonstrations.episodes.images[:, 0] = 1  # but no image is all zeros
    algorithm, _ = episode_bc(policy, demonstrations, seed=0, **{**SETTINGS, "batch_size": 8, "learning_rate": 1e-3})
    algorithm.train(n_epochs=100, progress_bar=False)
    with th.no_grad():
        sequences = demonstrations.episodes.sequences()
        memory = policy.network.remember(sequences)
        learned = policy.action_distribution(policy.network.latent(memory, scene_of(memory, sequences.lengths))).mode()
    assert (learned.numpy() == actions).mean() > 0.95


def test_the_same_seed_gives_the_same_agent():
    weights = []
    for seed in (0, 0, 1):
        policy = make_policy(RecurrentGuidePolicy)
        episode_bc(policy, make_demonstrations([3, 2, 4, 3]), seed=seed, **SETTINGS)[0].train(n_epochs=3, progress_bar=False)
        weights.append(policy.action_net.weight)
    assert th.equal(weights[0], weights[1])
    assert not th.equal(weights[0], weights[2])


def test_windows_are_not_cloned():
    with pytest.raises(ValueError, match="LearnerPolicy remembers windows: expected RecurrentLearnerPolicy"):
        episode_bc(make_policy(LearnerPolicy), make_demonstrations([3, 2]), seed=0, **SETTINGS)


def test_pictures_of_the_language_after_each_epoch(tmp_path):
    logger = HierarchicalLogger(Logger(folder=None, output_formats=[TensorBoardOutputFormat(str(tmp_path))]))
    policy = make_policy(RecurrentGuidePolicy)
    algorithm, _ = episode_bc(policy, make_demonstrations([2, 3]), seed=0, **{**SETTINGS, "logger": logger})
    pictures = LanguagePictures(policy, "GoToObj", logger, n_episodes=2)
    algorithm.train(n_epochs=2, on_epoch_end=pictures, progress_bar=False)
    assert policy.training
    events = EventAccumulator(str(tmp_path), size_guidance={"images": 0})
    events.Reload()
    for name in ("guide/actions", "guide/episode"):
        assert [picture.step for picture in events.Images(name)] == [1, 2]
