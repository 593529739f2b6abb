"use strict";
/* Curves over time and over frequency, by uPlot in the page's colours. */

const color = name => () => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const faint = color("--grid"), ink = color("--text"), gray = color("--gray");
const COLORS = Array.from({length: 6}, (_, k) => color(`--curve-${k}`));
const FONT = "12px system-ui, sans-serif";

function axis(label, size) {
    return {label, size, stroke: ink, font: FONT, labelFont: FONT, labelSize: 18, labelGap: 0,
        values: (_, at) => at.map(x => x === null ? "" : general(x, 6).replace("-", "−")),
        grid: {stroke: faint, width: 1}, ticks: {stroke: faint, width: 1, size: 4}};
}

/** Paints on a plot: `paints` receives the canvas context, functions from values to positions along x and y, and the
    frame; `within` clips at the frame. */
function paint(u, paints, within = false) {
    const {ctx, bbox} = u;
    ctx.save();
    ctx.beginPath();
    if (within) {
        ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
        ctx.clip();
        ctx.beginPath();
    }
    paints(ctx, x => u.valToPos(x, "x", true), y => u.valToPos(y, "y", true), bbox);
    ctx.restore();
}

/** A line at a value of a scale, across the plot, with a text at its end, above or below. */
function rule(u, scale, value, text, below = false) {
    paint(u, (ctx, x, y, {left, top, width, height}) => {
        const across = scale !== "x", at = across ? y(value) : x(value), pixel = devicePixelRatio;
        if (across ? at < top || at > top + height : at < left || at > left + width) return;
        ctx.strokeStyle = ctx.fillStyle = gray();
        ctx.setLineDash([2, 3]);
        ctx.font = `${11 * pixel}px system-ui, sans-serif`;
        ctx.moveTo(across ? left : at, across ? at : top);
        ctx.lineTo(across ? left + width : at, across ? at : top + height);
        ctx.stroke();
        ctx.textAlign = "right";
        const end = across ? left + width : at;
        ctx.fillText(text, end - 4 * pixel, across ? at + (below ? 12 : -4) * pixel : top + height - 6 * pixel);
    });
}

/** Shades the times at which a flag is set. */
function shade(u, time, flag) {
    paint(u, (ctx, x, y, {top, height}) => {
        ctx.fillStyle = color("--shade")();
        for (let k = 0; k < flag.length; ++k) {
            if (flag[k] <= 0.5) continue;
            const first = x(time[k]);
            while (k + 1 < flag.length && flag[k + 1] > 0.5) ++k;
            ctx.fillRect(first, top, Math.max(x(time[k]) - first, devicePixelRatio), height);
        }
    });
}

/** The band of the required accuracy around a command. */
function band(u, time, command, width) {
    paint(u, (ctx, x, y) => {
        for (let k = 0; k < time.length; ++k) ctx.lineTo(x(time[k]), y(command[k] + width));
        for (let k = time.length - 1; k >= 0; --k) ctx.lineTo(x(time[k]), y(command[k] - width));
        ctx.fillStyle = color("--band")();
        ctx.fill();
    }, true);
}

/** Shades gains that miss the required bandwidth: below `floor` up to the frequency `end`. */
function forbidden(u, end, floor) {
    paint(u, (ctx, x, y, {left, top, height}) => {
        ctx.fillStyle = color("--forbidden")();
        ctx.fillRect(left, y(floor), x(end) - left, top + height - y(floor));
    }, true);
}

/** A ring at a point. */
function mark(u, at, level, stroke) {
    if (!Number.isFinite(at)) return;
    paint(u, (ctx, x, y) => {
        [ctx.strokeStyle, ctx.fillStyle, ctx.lineWidth] = [stroke, color("--back")(), 2 * devicePixelRatio];
        ctx.setLineDash([]);
        ctx.arc(x(at), y(level), 4 * devicePixelRatio, 0, 2 * Math.PI);
        ctx.fill();
        ctx.stroke();
    });
}

/** A plot as wide as its figure in the page. */
class Plot {
    constructor(title, {x, y, log = false, height = 190, shared = true}) {
        this.figure = document.createElement("figure");
        this.figure.innerHTML = `<figcaption></figcaption><div class="plot" role="img"></div>`;
        this.figure.firstChild.textContent = title;
        this.box = this.figure.lastChild;
        this.title = title;
        this.look = {x, y, log, height, shared};
        this.names = "";
        this.ticks = [];  // of an axis of names: position, name
        this.under = this.over = () => undefined;
        new ResizeObserver(() => this.resize()).observe(this.box);
    }

    resize() {
        const width = this.box.clientWidth;
        if (this.chart && width) this.chart.setSize({width, height: this.look.height});
    }

    /** Draws curves {label, x, y, stroke, dash, width, step}, which may have different x. */
    draw(curves) {
        const xs = [...new Set(curves.map(curve => curve.x))], by = x => curves.filter(curve => curve.x === x);
        const ordered = xs.flatMap(by), names = ordered.map(({label}) => label).join("\n");
        const tables = xs.map(x => [x, ...by(x).map(({y}) => y)]);
        const data = tables.length > 1 ? uPlot.join(tables) : tables[0];
        if (names === this.names) {
            this.chart.setData(data);
            return;
        }
        this.chart?.destroy();
        this.names = names;
        this.chart = new uPlot(this.options(ordered), data, this.box);
    }

    options(curves) {
        const {x, y, log, height, shared} = this.look;
        const value = (_, v) => v === null || v === undefined ? "–" : shownNumber(v);
        return {
            width: this.box.clientWidth || 300, height,
            legend: {markers: {width: 2, dash: (_, k) => !curves[k - 1]?.dash ? "solid" :
                curves[k - 1].dash[0] > 2 ? "dashed" : "dotted"}},
            cursor: {sync: shared ? {key: "time"} : undefined, points: {size: 5}, drag: {x: true, y: false}},
            scales: {x: {time: false, distr: log ? 3 : 1, range: (_, least, most) => [least, most]},
                y: {range: (_, least, most) =>
                    this.ticks.length ? [this.ticks[0][0] - 0.3, this.ticks[0][0] + this.ticks.length - 0.2] :
                    least === most ? [least - 1, most + 1] : uPlot.rangeNum(least, most, 0.1, true)}},
            axes: [axis(x, 26), this.ticks.length ? this.axisOfNames() : axis(y, 58)],
            series: [{label: x.replace(/ .*/, ""), value}, ...curves.map(curve => ({
                label: curve.label, stroke: curve.stroke, width: curve.width ?? 1.6, dash: curve.dash,
                value: curve.value ?? value, spanGaps: true, points: {show: false},
                paths: curve.step ? uPlot.paths.stepped({align: 1}) : undefined}))],
            hooks: {init: [u => u.root.classList.add("idle")],
                setCursor: [({root, cursor}) => root.classList.toggle("idle", (cursor.idx ?? null) === null)],
                drawAxes: [u => this.under(u)], draw: [u => this.over(u)]},
        };
    }

    axisOfNames() {
        return {...axis("", 110), labelSize: 0, splits: () => this.ticks.map(([at]) => at),
            values: () => this.ticks.map(([, name]) => name)};
    }

    redraw() {
        this.chart?.redraw(false, true);
    }

    describe(text) {
        this.box.setAttribute("aria-label", `${this.title}: ${text}`);
    }
}

/** A number for people: four digits. */
function shownNumber(x) {
    if (x === null || Number.isNaN(x)) return "–";
    if (!Number.isFinite(x)) return "not reached";
    return (Math.abs(x) >= 1e4 ? x.toFixed(0) : general(x, 4)).replace("-", "−");
}
