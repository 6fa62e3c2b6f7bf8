"""Learn to follow a track: 256 cars drive, the next ones are drawn around the best ones.

A controller of four numbers on DartCar-v0, found by the cross-entropy method
(R. Rubinstein, 1999). Needs gymnasium: pip install -e '.[gym]'

    python examples/learn_to_follow.py
"""

import numpy as np

try:
    import gymnasium
except ImportError as err:
    raise SystemExit("this example needs gymnasium: pip install -e '.[gym]'") from err

CARS, ROUNDS, STEPS, BEST = 256, 8, 200, 24
ENV = "dart_lab.sim.gym:DartCar-v0"


def steer(seen: dict[str, np.ndarray], k: np.ndarray) -> np.ndarray:
    """Actions (n, 2) of controllers k (4, n): pursuit gain, damping, drive, speed gain."""
    x, y = seen["x_0.6"], seen["y_0.6"]
    steering = k[0] * 2.0 * 0.1735 * y / (x**2 + y**2) - k[1] * seen["yaw_rate"]
    throttle = k[2] + k[3] * (seen["reference_speed"] - seen["speed"])
    return np.clip(np.stack([throttle, steering], axis=1), -1.0, 1.0)


def drive(env: gymnasium.vector.VectorEnv, k: np.ndarray, seed: int) -> np.ndarray:
    """Mean reward per step of each car until its episode ends."""
    observation, _ = env.reset(seed=seed)
    names, total = env.names, np.zeros(env.num_envs)
    alive = np.ones(env.num_envs, dtype=bool)
    for _ in range(STEPS):
        action = steer(dict(zip(names, observation.T, strict=True)), k)
        observation, reward, ended, _, _ = env.step(action.astype(np.float32))
        total += alive * reward
        alive &= ~ended
    return total / STEPS


env = gymnasium.make_vec(ENV, num_envs=CARS, speed=1.8, episode=STEPS * 0.05)
rng = np.random.default_rng(1)
mean, spread = np.zeros(4), np.array([2.0, 0.3, 0.3, 0.3])
for r in range(ROUNDS):
    k = mean[:, None] + spread[:, None] * rng.standard_normal((4, CARS))
    reward = drive(env, k, seed=1000 * r)
    chosen = k[:, np.argsort(reward)[-BEST:]]
    mean, spread = chosen.mean(axis=1), chosen.std(axis=1)
    print(f"round {r + 1}: reward per step {np.median(reward):+.2f}, the best {reward.max():+.2f}")

learnt = drive(env, np.repeat(mean[:, None], CARS, axis=1), seed=1_000_000)
print(f"learnt {np.round(mean, 2).tolist()}: {learnt.mean():+.2f} per step on new starts, "
      f"{int((learnt > 0).sum())} of {CARS} stay on the track")
