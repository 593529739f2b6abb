/* The poles of the closed loop, s/(2 pi) [Hz]. The user moves an unstable pair or the slowest, and two gains are set to
 * place it. */

const PLACING = [["controller.position.kp", "controller.velocity.kp"], ["controller.kp", "controller.kd"]].find(names =>
    names.every(name => CONTROLS.has(name)));
const LEAST = 0.02; // smallest imaginary part of a moved pole, as a share of the plot's height: it stays complex
const KEYS = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]};

/** The poles of a closed loop [Hz] in the upper half plane. */
function upperPoles({poles, period}) {
    const size = 2 * Math.PI * period;
    return poles.filter(([x, y]) => Math.hypot(x, y) > 1e-9 && y >= 0).map(([x, y]) =>
        [Math.log(Math.hypot(x, y)) / size, Math.atan2(y, x) / size]);
}

/** The complex pole [Hz] that is nearest to a point [Hz]; undefined if all poles are real. */
function nearest(poles, [x, y]) {
    const pairs = poles.filter(([, imaginary]) => imaginary > 1e-6);
    const distances = pairs.map(([a, b]) => Math.hypot(a - x, b - y));
    return pairs[distances.indexOf(smallest(distances))];
}

/** The `gains`, within their ranges, that bring a pole as near to a target as possible, and the `pole` they reach. The
    method is Gauss-Newton, with steps shortened until the distance falls. `polesAt(gains, keep)` returns the poles;
    with `keep`, none if the gains would destabilise the loop. */
function placePole(polesAt, gains, ranges, pole, target) {
    const errorOf = at => [0, 1].map(i => target[i] - at[i]);
    for (let k = 0, share = 1; k < 20 && share > 0.02; ++k) {
        const error = errorOf(pole), far = Math.hypot(...error) / Math.hypot(...pole);
        if (far < 1e-7) break;
        const [u, v] = error.map(x => x * share * Math.min(1, 0.3 / far));  // a longer step could lose the pole
        const [[a, b], [c, d]] = gains.map((gain, i) => {
            const h = 1e-4 * (gain || ranges[i][1]), moved = nearest(polesAt(gains.with(i, gain + h)), pole);
            return moved?.map((x, j) => (x - pole[j]) / h) ?? [NaN, NaN];
        });
        const clipped = (x, i) => Math.min(Math.max(x, ranges[i][0]), ranges[i][1]), size = a * d - b * c;
        let next = [gains[0] + (d * u - c * v) / size, gains[1] + (a * v - b * u) / size];
        const at = next.findIndex((x, i) => clipped(x, i) !== x);
        if (at >= 0) {  // one gain stays at an end of its range; the other brings the pole as near as possible
            const [[p, q], [r, s]] = at ? [[c, d], [a, b]] : [[a, b], [c, d]];
            const step = clipped(next[at], at) - gains[at];
            const other = (r * (u - p * step) + s * (v - q * step)) / (r * r + s * s);
            next = at ? [gains[0] + other, gains[1] + step] : [gains[0] + step, gains[1] + other];
        }
        next = next.map(clipped);
        const [x, y] = next.map((gain, i) => gain - gains[i]);
        const expected = [pole[0] + a * x + c * y, pole[1] + b * x + d * y];
        const reached = next.every(Number.isFinite) && nearest(polesAt(next, true), expected);
        if (reached && Math.hypot(...errorOf(reached)) < (1 - 1e-6) * Math.hypot(...error)) {
            [gains, pole, share] = [next, reached, 1];
        } else {
            share /= 4;
        }
    }
    return {gains, pole};
}

class Poles {
    /** Calls `change(target, pole)` when the user moves a pole [Hz]; `change` returns the pole that is reached. */
    constructor(change) {
        this.plot = new Plot("Poles of the closed loop", {x: "real part [Hz]", y: "imaginary part [Hz]", shared: false,
            legend: false, height: 235});
        this.change = change;
        this.handle = element("button", {type: "button", class: "handle"});
        this.plot.box.setAttribute("role", "group");
        this.plot.sketch = u => this.place(u);
        const listen = (name, action) => this.handle.addEventListener(name, action);
        listen("mousedown", at => at.stopPropagation());
        listen("pointerdown", at => {
            this.handle.setPointerCapture(at.pointerId);
            this.dragged = true;
        });
        listen("pointermove", at => this.dragged && this.move(this.plot.at(at)));
        for (const name of ["pointerup", "pointercancel"]) listen(name, () => { this.dragged = false; });
        listen("keydown", key => {
            const step = KEYS[key.key];
            if (!step || !this.pole) return;
            key.preventDefault();
            this.move(this.pole.map((x, i) => x + step[i] * this.size / 100));
        });
    }

    move([x, y]) {
        if (this.pole) this.pole = this.change([x, Math.max(y, LEAST * this.size)], this.pole);
    }

    place(u) {
        this.handle.hidden = !this.pole || !PLACING;
        if (this.handle.hidden) return;
        if (this.handle.parentNode !== u.over) u.over.append(this.handle);
        const [left, top] = [u.valToPos(this.pole[0], "x"), u.valToPos(this.pole[1], "y")];
        Object.assign(this.handle.style, {left: `${left}px`, top: `${top}px`});
    }

    draw(loops) {
        const {poles} = loops.at(-1), slowest = nearest(poles, [0, 0]);
        const first = nearest(poles.filter(([real]) => real >= 0), [0, 0]) ?? slowest;
        /* While the user moves a pair, this pair stays chosen. */
        const isMoved = (this.dragged || document.activeElement === this.handle) && this.pole;
        this.pole = isMoved ? nearest(poles, this.pole) : first;
        const reach = this.pole ? Math.hypot(...this.pole) : 25;
        if (!this.dragged) this.size = 2 ** Math.ceil(Math.log2(1.5 * reach));
        this.plot.under = u => filled(u, "--forbidden", (ctx, x, y, {left, top, width, height}) =>
            ctx.rect(x(0), top, left + width - x(0), height));
        this.plot.over = u => {
            for (const damping of [0.2, 0.4, 0.6, 0.8]) ray(u, damping, this.size);
            for (const {poles: of, stroke} of loops) of.forEach(pole => cross(u, pole, stroke()));
        };
        const {size} = this;
        this.plot.draw([{label: "", x: [-size, size / 4], y: [-size / 20, size], stroke: gray, width: 0}]);
        const which = this.pole?.[0] >= 0 ? "unstable" : this.pole === slowest ? "slowest" : "chosen";
        const text = this.pole ? `the ${which} pair at ${withUnit(reach, "Hz")} with damping ` +
            shownNumber(-this.pole[0] / reach) : "no pair of complex poles";
        this.plot.describe(text);
        this.handle.setAttribute("aria-label", `Pole, ${text}: arrow keys move it`);
    }
}
