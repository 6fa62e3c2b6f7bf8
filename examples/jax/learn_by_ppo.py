"""Learn to follow a track by PPO: 512 drawn cars drive on JAX, and a small network learns.

Proximal policy optimisation (J. Schulman et al., 2017) with clipped ratios and generalised
advantages. It is judged on cars and starts that it has not met, compared with pure pursuit.
Needs JAX: pip install -e '.[jax]'

    python examples/jax/learn_by_ppo.py [UPDATES]
"""

import sys
import time

import jax
import jax.numpy as jnp
import numpy as np

from dart_hal import track_named
from dart_lab.sim.jax import DartCar

CARS, STEPS, UPDATES, SPEED, PERIOD = 512, 24, 50, 1.5, 0.05  # -; -; -; m/s; s
EPOCHS, PARTS, RATE, CLIP = 4, 4, 1e-3, 0.2
DISCOUNT, TRACE, ENTROPY, REWARD_SCALE = 0.97, 0.95, 1e-3, 0.1
HIDDEN, FIRST_STD = 64, 0.4
TRACK = "racetrack_vicon_2"
LAP = track_named(TRACK).length  # m
ENV = DartCar(track=TRACK, speed=SPEED, period=PERIOD, randomise=True)
reset = jax.jit(jax.vmap(ENV.reset))


def make_network(key):
    """Two networks with one hidden layer: mean of the action, and value of the state."""
    inputs = len(ENV.names)

    def layers(key, outputs, last):
        a, b, c = jax.random.split(key, 3)
        return [(jax.random.normal(k, (n, m)) * gain / n**0.5, jnp.zeros(m)) for k, n, m, gain in (
            (a, inputs, HIDDEN, 1.0), (b, HIDDEN, HIDDEN, 1.0), (c, HIDDEN, outputs, last))]

    actor, critic = jax.random.split(key)
    return {"actor": layers(actor, 2, 0.01), "critic": layers(critic, 1, 1.0),
            "log_std": jnp.full(2, np.log(FIRST_STD))}


def apply(layers, x):
    for w, b in layers[:-1]:
        x = jnp.tanh(x @ w + b)
    w, b = layers[-1]
    return x @ w + b


def log_density(net, observed, action):
    """Logarithm of the probability density of actions (n, 2)."""
    z = (action - apply(net["actor"], observed)) * jnp.exp(-net["log_std"])
    return jnp.sum(-0.5 * z**2 - net["log_std"], axis=-1)


def pursue(observed):
    """Pure pursuit: steer along the circle to the point 0.6 m ahead, hold the speed."""
    at = {name: observed[:, i] for i, name in enumerate(ENV.names)}
    curvature = 2.0 * at["y_0.6"] / (at["x_0.6"] ** 2 + at["y_0.6"] ** 2)
    throttle = 0.27 + 0.5 * (at["reference_speed"] - at["speed"])
    return jnp.stack([throttle, jnp.arctan(0.1735 * curvature) / 0.4], axis=1)


@jax.jit
def step(net, scale, state, observed, starts, key, explore, pursuit):
    """Advance all cars; one whose episode ended begins again at one of ``starts``.

    explore: 0 = the mean of the policy; pursuit: 1 = the baseline instead of the network.
    """
    own, which = jax.random.split(key)
    noise = explore * jnp.exp(net["log_std"]) * jax.random.normal(own, (len(observed), 2))
    action = apply(net["actor"], observed / scale) + noise
    out = jax.vmap(ENV.step)(state, jnp.where(pursuit, pursue(observed), action))
    done = out.terminated | out.truncated
    at = jax.random.randint(which, (len(observed),), 0, len(observed))
    first, fresh = jax.tree.map(lambda v: v[at], starts)

    def choose(new, old):
        return jnp.where(done.reshape(-1, *[1] * (old.ndim - 1)), new, old)

    # Each car keeps its keys of random numbers.
    fresh = fresh._replace(key=out.state.key, car=fresh.car._replace(key=out.state.car.key))
    state = jax.tree.map(choose, fresh, out.state)
    row = (observed / scale, action, REWARD_SCALE * out.reward, out.terminated, done,
           out.observation / scale)
    return state, choose(first, out.observation), row, out.info["s"]


def loss(net, observed, action, density, advantage, target):
    ratio = jnp.exp(log_density(net, observed, action) - density)
    gain = jnp.minimum(ratio * advantage, jnp.clip(ratio, 1 - CLIP, 1 + CLIP) * advantage)
    value = apply(net["critic"], observed)[:, 0]
    return -gain.mean() + 0.5 * jnp.mean((value - target) ** 2) - ENTROPY * net["log_std"].sum()


@jax.jit
def learn(net, adam, rows, key):
    """Update the network by the rows (STEPS, CARS, ...) of a rollout."""
    observed, action, reward, terminated, done, then = rows
    value, value_then = (apply(net["critic"], v)[..., 0] for v in (observed, then))
    error = reward + DISCOUNT * value_then * (1.0 - terminated) - value

    # A_t = error_t + DISCOUNT TRACE A_(t+1) within an episode.
    def back(later, now):
        later = now[0] + DISCOUNT * TRACE * (1.0 - now[1]) * later
        return later, later

    advantage = jax.lax.scan(back, jnp.zeros(CARS), (error, done), reverse=True)[1]
    target = advantage + value
    advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-6)
    data = (observed, action, log_density(net, observed, action), advantage, target)
    data = jax.tree.map(lambda v: v.reshape(STEPS * CARS, *v.shape[2:]), data)
    order = [jax.random.permutation(k, STEPS * CARS) for k in jax.random.split(key, EPOCHS)]

    def descend(now, part):
        net, (first, second, n) = now
        slope = jax.grad(loss)(net, *jax.tree.map(lambda v: v[part], data))
        first = jax.tree.map(lambda m, g: 0.9 * m + 0.1 * g, first, slope)
        second = jax.tree.map(lambda m, g: 0.999 * m + 0.001 * g**2, second, slope)
        n = n + 1
        net = jax.tree.map(lambda p, m, v: p - RATE * m / (1 - 0.9**n) / (
            jnp.sqrt(v / (1 - 0.999**n)) + 1e-8), net, first, second)
        return (net, (first, second, n)), None

    parts = jnp.stack(order).reshape(EPOCHS * PARTS, -1)
    return jax.lax.scan(descend, (net, adam), parts)[0]


def judge(net, scale, key, pursuit=False):
    """Mean share of a lap before the car leaves the lane, and share of cars that never do."""
    first, state = starts = reset(jax.random.split(key, CARS))
    begun, inside, share = np.asarray(state.memory.s), np.ones(CARS, bool), np.zeros(CARS)
    observed = first
    for _ in range(round(1.2 * LAP / SPEED / PERIOD)):
        state, observed, row, s = step(net, scale, state, observed, starts, key, 0.0, pursuit)
        inside &= ~np.asarray(row[3])
        share = np.where(inside, np.clip((np.asarray(s) - begun) / LAP, share, 1.0), share)
    return share.mean(), inside.mean()


def main(updates=UPDATES):
    """Print and return (share of a lap, share of cars) of pursuit, before and after learning."""
    key = jax.random.key(1)
    net = make_network(key)
    adam = (jax.tree.map(jnp.zeros_like, net), jax.tree.map(jnp.zeros_like, net), 0)
    observed, state = starts = reset(jax.random.split(jax.random.key(2), CARS))
    scale = jnp.std(observed, axis=0) + 0.1
    unseen = jax.random.key(1_000_000)
    print("share of a lap in the lane, share of cars that stay in it:")
    baseline = judge(net, scale, unseen, pursuit=True)
    print(f"pure pursuit        {baseline[0]:4.0%} {baseline[1]:4.0%}")
    before = judge(net, scale, unseen)
    print(f"before learning     {before[0]:4.0%} {before[1]:4.0%}")
    for k in range(updates):
        rows = []
        for _ in range(STEPS):
            key, own = jax.random.split(key)
            state, observed, row, _ = step(net, scale, state, observed, starts, own, 1.0, False)
            rows.append(row)
        rows = [jnp.stack(column) for column in zip(*rows, strict=True)]
        key, own = jax.random.split(key)
        net, adam = learn(net, adam, rows, own)
        if k % 10 == 9:
            print(f"update {k + 1}: reward {float(rows[2].mean()) / REWARD_SCALE:+.2f} a step, "
                  f"{time.process_time():.0f} s of CPU")
    after = judge(net, scale, unseen)
    print(f"after {updates} updates   {after[0]:4.0%} {after[1]:4.0%}")
    return baseline, before, after


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
