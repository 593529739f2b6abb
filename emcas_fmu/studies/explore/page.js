"use strict";
/* The page: what the user sets goes to the actuator, its response to plots and tables. B is live, A is kept. */

const $ = id => document.getElementById(id);
const REST = 300; // ms without a change, after which what takes longer is computed
const BUSY = 16; // ms, after which what takes longer lets the page answer
const MOST_BYTES = 50e6; // of a CSV file, which a browser reads whole

class Page {
    constructor(unit) {
        this.unit = unit;
        this.live = {setting: new Setting()};
        this.kept = null;
        const change = (name, value) => this.change(name, value);
        this.controls = [...firstControls(change), ...allControls(change, $("search"), $("all"))];
        this.plots = DATA.panels.map(({title, shown: [unit]}, k) => new Plot(title, {
            x: "time [s]", y: unit && `[${typeset(unit)}]`, height: k ? 170 : innerWidth < 640 ? 165 : 235}));
        this.plots.forEach((plot, k) => k ? $("plots").append(plot.figure) : $("main-plot").prepend(plot.figure));
        this.gain = new Plot("Gain of the fin angle over the command",
            {x: "frequency [Hz]", y: "[dB]", log: true, shared: false});
        this.phase = new Plot("Phase", {x: "frequency [Hz]", y: "[°]", log: true, shared: false});
        $("bode").append(this.gain.figure, this.phase.figure);
        this.listen();
        this.restore();
    }

    listen() {
        $("shape").append(...Object.entries(SHAPES).map(([value, {title}]) => element("option", {value}, title)));
        $("shape").addEventListener("change", () => {
            if ($("shape").value === "csv") $("file").click();
            this.change("excitation.shape", $("shape").value);
        });
        $("file").addEventListener("change", () => this.open($("file").files[0]));
        $("keep").addEventListener("click", () => this.keep());
        $("drop").addEventListener("click", () => { this.kept = null; this.refresh(); });
        $("swap").addEventListener("click", () => { [this.live, this.kept] = [this.kept, this.live]; this.refresh(); });
        $("reset").addEventListener("click", () => { this.live = {setting: new Setting()}; this.narrow(); });
        $("link").addEventListener("click", () => this.copyLink());
        $("save-parameters").addEventListener("click", () => save("parameters.toml", parameterFile(this.live.setting)));
        $("save-inputs").addEventListener("click", () => save("inputs.csv", csv(this.inputs())));
        $("save-response").addEventListener("click", () => save("response.csv", csv(this.response())));
        window.addEventListener("hashchange", () => this.restore());
        for (const media of ["(prefers-color-scheme: dark)", "print"]) {
            window.matchMedia(media).addEventListener("change", () => this.redraw());
        }
        window.addEventListener("beforeprint", () => this.redraw());
    }

    change(name, value) {
        const {setting} = this.live;
        this.live = {setting: setting.with(name, value === undefined ? setting.default(name) : value)};
        this.refresh();
    }

    /** Begin with the sliders' own ranges. */
    narrow() {
        for (const control of this.controls) control.range = null;
        this.refresh();
    }

    keep() {
        this.kept = this.live;
        this.live = {...this.live};
        this.refresh();
    }

    async open(file) {
        if (!file) return;
        try {
            if (file.size > MOST_BYTES) throw new Error(`${file.name}: is larger than ${MOST_BYTES / 1e6} MB`);
            this.live = {setting: this.live.setting.withFile(fromCsv(await file.text(), file.name))};
            this.refresh();
        } catch (error) {
            this.say([error.message]);
        }
        $("file").value = "";
    }

    /** Take the settings of the address, if it has any. */
    restore() {
        if (location.hash === this.written) return;
        const link = new URLSearchParams(location.hash.slice(1)), notes = [];
        const read = text => {
            const [setting, unknown] = Setting.parse(text);
            if (unknown.length) notes.push(`The link has ${unknown.join(", ")}, unknown to this page: left out.`);
            return {setting};
        };
        this.kept = link.has("A") ? read(link.get("A")) : null;
        this.live = read(link.get("B") ?? "");
        const other = link.has("of") && link.get("of") !== DATA.digest;
        if (other) notes.push("The link is from another page: what it does not set may differ.");
        $("notes").textContent = notes.join(" ");
        this.narrow();
    }

    /** Show what is set, and compute it before the next frame. */
    refresh() {
        const {setting} = this.live, shape = SHAPES[setting.shape];
        $("shape").value = setting.shape;
        $("file-row").hidden = setting.shape !== "csv";
        $("file-name").textContent = setting.file ? setting.file.title : "none chosen";
        for (const control of this.controls) {
            control.show(setting);
            const [, field] = control.control.name.split("excitation.");
            if (field) control.row.hidden = !shape.fields.includes(field);
        }
        for (const id of ["drop", "swap"]) $(id).disabled = !this.kept;
        $("keep").setAttribute("aria-pressed", String(this.kept !== null));
        cancelAnimationFrame(this.frame);
        clearTimeout(this.resting);
        this.frame = requestAnimationFrame(() => this.compute());
    }

    compute() {
        const problems = this.answer(this.live);
        const ofKept = this.kept ? this.answer(this.kept) : [];
        this.say(problems, [...this.live.warnings ?? [], ...ofKept.map(problem => `A is not shown: ${problem}`)]);
        for (const name of ["parameters", "inputs", "response"]) $(`save-${name}`).disabled = problems.length > 0;
        if (problems.length) return;
        for (const control of this.controls) control.widen(this.live.setting);
        this.drawTimes();
        drawFigures($("figures"), this.cases);
        document.body.classList.add("waiting");
        this.resting = setTimeout(() => this.rest(), REST);
    }

    /** Compute the response of a case {setting} in place, if it is not there; gives what is wrong. */
    answer(each) {
        if (each.run || each.problems) return each.problems ?? [];
        const {setting} = each, {parameters, unreadable} = setting;
        const problems = unreadable.length ? unreadable : [...setting.problems, ...this.unit.problems(parameters)];
        try {
            if (!problems.length) {
                each.run = this.respond(setting, setting.excite());
                each.figures = figures(each.run);
                each.warnings = [...clipped(setting, each.run.excitation), ...this.unit.broken(parameters, true)];
            }
        } catch (error) {
            problems.push(error.message);
        }
        if (problems.length) each.problems = problems;
        return problems;
    }

    respond(setting, excitation, changes = {}, outputs = undefined) {
        const inputs = setting.inputs(excitation), parameters = {...setting.parameters, ...changes};
        return {excitation, outputs: this.unit.run(parameters, inputs, excitation.time.length, STEP, outputs)};
    }

    /** A `respond` of measure.js, of a setting with parameters that differ, beside which the page answers its user. */
    beside(setting, changes) {
        const {live, kept} = this;
        return async (excitation, outputs) => {
            if (performance.now() > this.due) {
                await new Promise(resolve => setTimeout(resolve));
                this.due = performance.now() + BUSY;
            }
            if (this.live !== live || this.kept !== kept) return new Promise(() => undefined);  // not wanted any more
            try {
                return this.respond(setting, excitation, changes, outputs);
            } catch {
                return null;
            }
        };
    }

    say(problems, warnings = []) {
        $("problems").replaceChildren(...problems.map(problem => element("p", {}, problem)));
        $("warnings").replaceChildren(...warnings.map(warning => element("p", {}, warning)));
        document.body.classList.toggle("stale", problems.length > 0);
    }

    get cases() {
        const shown = [["B", this.live]];
        return this.kept?.run ? [["A", this.kept], ...shown] : shown;
    }

    drawTimes() {
        DATA.panels.forEach((panel, number) => drawPanel(this.plots[number], panel, number, this.cases));
    }

    /** Let the address be the link of what is set; browsers allow this only so often. */
    writeLink() {
        const {live, kept} = this;
        const link = new URLSearchParams({of: DATA.digest, ...(kept ? {A: kept.setting} : {}), B: live.setting});
        history.replaceState(null, "", `#${link}`);
        this.written = location.hash;
    }

    /** What takes longer, unless something changes meanwhile: the Bode plot, requirements, words, the link. */
    async rest() {
        this.writeLink();
        this.tell();
        this.due = 0;
        for (const [, each] of this.cases) each.responses ??= await this.responses(each.setting);
        drawBode(this.gain, this.phase, this.cases);
        $("bode-summary").textContent = bodeSummary(this.cases);
        for (const [, each] of this.cases) each.measured ??= await this.measured(each.setting);
        drawRequirements($("requirements"), this.cases);
        document.body.classList.remove("waiting");
        document.body.dataset.ready = String(Number(document.body.dataset.ready ?? 0) + 1);
    }

    /** The frequency responses that are shown of a setting, each with its label. */
    async responses(setting) {
        const respond = this.beside(setting, DATA.at_start), found = [];
        for (const [amplitude, load] of sinesOf(setting)) {
            const label = `${shownNumber(degrees(amplitude))}°${load ? `, ${shownNumber(load)} N·m` : ""}`;
            found.push([label, await frequencyResponse(amplitude, load, respond)]);
        }
        return found;
    }

    /** The figures of every test of the requirements, by its cases. */
    async measured(setting) {
        const found = [];
        for (const test of DATA.tests) {
            const figures = {};
            for (const name of test.cases) {
                figures[name] = await measure(test, setting, this.beside(setting, DATA.cases[name]));
            }
            found.push(figures);
        }
        return found;
    }

    /** The response in words, for who does not see it. */
    tell() {
        const listed = Object.entries(this.live.figures).filter(([name]) => DATA.headlines.includes(name));
        $("summary").textContent = listed.map(([name, value]) => `${words(name)} ${inUnit(name, value)}`).join(", ");
        DATA.panels.forEach((panel, k) => this.plots[k].describe(panel.names.map(name => {
            const column = this.live.run.outputs[name], [unit, factor] = panel.shown;
            if (named(panel)) return `${words(name)} at the end ${named(panel)(column[column.length - 1])}`;
            const [least, most, last] = [-largest(column.map(x => -x)), largest(column), column[column.length - 1]];
            return `${words(name)} from ${shownNumber(least / factor)} to ${shownNumber(most / factor)} ${unit}, ` +
                `at the end ${shownNumber(last / factor)} ${unit}`;
        }).join("; ")));
    }

    inputs() {
        return givenInputs(this.live.setting, this.live.run.excitation);
    }

    response() {
        return {...this.inputs(), ...this.live.run.outputs};
    }

    async copyLink() {
        this.writeLink();
        try {
            await navigator.clipboard.writeText(location.href);
            $("copied").textContent = "link copied";
        } catch {
            $("copied").textContent = "the address of this page is the link: copy it from above";
        }
    }

    redraw() {
        for (const plot of [...this.plots, this.gain, this.phase]) plot.redraw();
    }
}

function save(name, text) {
    const blob = new Blob([text], {type: "text/plain"});
    const link = element("a", {href: URL.createObjectURL(blob), download: name});
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const loaded = Unit.load($("unit").textContent.trim()).then(unit => new Page(unit), error => {
    $("problems").textContent = `This browser does not run the page's unit: ${error.message}`;
});
