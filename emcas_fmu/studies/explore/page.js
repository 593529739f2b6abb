/* The page: plots and tables of the response to the user's setting (case B, live) and to a kept setting (case A). */

const $ = id => document.getElementById(id);
const PAUSE = 300; // ms without a change after which long computations begin

class Page {
    constructor(actuator) {
        this.actuator = actuator;
        this.background = new Background(["data", "actuator", "program"].map(id => $(id).textContent));
        this.controls = [...document.querySelectorAll("[data-name]")].map(row =>
            new Control(row, (name, value) => this.change(name, value)));
        this.plots = DATA.panels.map(({title, shown: [unit]}, k) => new Plot(title, {
            x: "time [s]", y: unit && `[${unit}]`, height: k ? 170 : innerWidth < 640 ? 165 : 235}));
        this.plots.forEach((plot, k) => k ? $("plots").append(plot.figure) : $("main-plot").prepend(plot.figure));
        this.mechanism = new Mechanism(time => this.plots[0].point(time));
        this.plots[0].pointed = time => {
            if (!this.mechanism.playing) this.mechanism.show(time);
        };
        $("plots").prepend(this.mechanism.figure);
        this.bode = bodePlots(["Gain of the fin angle over the command", "Phase"]);
        $("bode").append(...this.bode.map(plot => plot.figure));
        drawStrip($("verdicts"), $("verdict"), [["B", {}]]);
        this.plane = DATA.plane && new Plot("Motor torque over motor speed", {
            x: `motor speed [${DATA.plane.speed[0]}]`, y: `[${DATA.plane.torque[0]}]`, shared: false, height: 235});
        if (this.plane) $("plane").append(this.plane.figure);
        this.drawing = new Drawing(this.plots[0], points =>
            this.showFile(DRAWN, () => drawnFile(points(), this.live.setting)));
        this.loop = DATA.linear && new LoopPlots($("loop"), (target, pole) => this.movePole(target, pole));
        this.listen();
        this.restore();
    }

    listen() {
        $("search").addEventListener("input", () => searchControls($("search").value));
        $("kind").addEventListener("change", () => {
            if ($("kind").value === "csv") $("file").click();
            this.change("excitation.kind", $("kind").value);
        });
        $("preset").addEventListener("change", () => this.begin({
            setting: this.live.setting.withPreset(DATA.presets[Number($("preset").value)])}));
        $("file").addEventListener("change", () => this.open($("file").files[0]));
        for (const [id, action] of Object.entries({
            keep: () => this.keep(), swap: () => this.show(this.kept, this.live), link: () => this.copyLink(),
            drop: () => this.show(this.live, null), reset: () => this.begin({setting: new Setting()}),
            "save-parameters": () => this.save("parameters.toml", () => parameterFile(this.live.setting)),
            "save-inputs": () => this.save("inputs.csv", () => csv(this.inputs())),
            "save-response": () => this.save("response.csv", () =>
                csv({...this.inputs(), ...this.live.run.outputs}))})) {
            $(id).addEventListener("click", action);
        }
        window.addEventListener("hashchange", () => this.restore());
        const redraw = () => PLOTS.forEach(plot => plot.redraw());
        for (const media of ["(prefers-color-scheme: dark)", "print"]) {
            window.matchMedia(media).addEventListener("change", redraw);
        }
        window.addEventListener("beforeprint", redraw);
    }

    change(name, value) {
        const {setting} = this.live;
        this.show({setting: setting.with(name, value ?? setting.default(name))});
    }

    /** Sets two gains, within their sliders' ranges, to move a pole [Hz] towards a target; returns the pole reached. */
    movePole(target, pole) {
        const {setting} = this.live, closedAt = gains => {
            const changes = Object.fromEntries(PLACING.map((name, k) => [name, gains[k]]));
            const loop = linearised(this.actuator, setting, changes);
            return loop ? {...loop, poles: eigenvalues(loop.closed)} : {poles: []};
        };
        const start = PLACING.map(name => setting.get(name));
        const fastest = Math.max(DECAYS, growthOf(closedAt(start).poles));
        /* A stable loop stays stable, and an unstable one does not grow faster. */
        const polesAt = (gains, keep) => {
            const loop = closedAt(gains);
            return keep && growthOf(loop.poles) > fastest ? [] : upperPoles(loop);
        };
        const ranges = PLACING.map(name => this.controls.find(({control}) => control.name === name).range ?? [0, 0]);
        const reached = placePole(polesAt, start, ranges, pole, target);
        this.show({setting: PLACING.reduce((changed, name, k) =>
            changed.with(name, Number(general(reached.gains[k], 6))), setting)});
        return reached.pole;
    }

    show(live, kept = this.kept) {
        Object.assign(this, {live, kept});
        this.refresh();
    }

    /** Shows the setting of a link, preset or reset, with the initial ranges of the sliders and the initial pole. */
    begin(live, kept = this.kept) {
        for (const control of this.controls) control.range = null;
        if (this.loop) this.loop.poles.pole = null;
        this.show(live, kept);
    }

    keep() {
        this.show({...this.live}, this.live);
    }

    async open(file) {
        if (!file) return;
        await this.showFile(file.name, () => {
            if (file.size > MOST_BYTES) throw new Error(`${file.name}: the file is larger than ${MOST_BYTES / 1e6} MB`);
            return file.text();
        });
        $("file").value = "";
    }

    /** Shows the response to the CSV file whose text `read` returns, or the error in the file. */
    async showFile(title, read) {
        try {
            const text = await read(), rows = fromCsv(text, title);
            const file = {...rows, text, packed: await packed(title, text)};
            this.show({setting: new Setting({...this.live.setting.values, "excitation.kind": "csv"}, file)});
        } catch (error) {
            this.showMessages([error.message]);
        }
    }

    /** Reads the settings from the page's address and shows them. */
    async restore() {
        if (location.hash === this.hash) return;
        const link = new URLSearchParams(location.hash.slice(1)), notes = [];
        const files = {};
        for (const name of ["A", "B"].filter(letter => link.has(`${letter}.csv`))) {
            try {
                files[name] = await unpacked(link.get(`${name}.csv`));
            } catch (error) {
                notes.push(`The link's CSV file of ${name} is not readable (${error.message}) and is left out.`);
            }
        }
        const read = name => {
            const [{values}, unknown] = Setting.parse(link.get(name) ?? "");
            const setting = new Setting(values, files[name]);
            const names = unknown.join(", ");
            if (names) notes.push(`Left out of the link: ${names}, unknown to this page or invalid.`);
            return {setting};
        };
        const kept = link.has("A") ? read("A") : null, live = read("B");
        if (link.has("of") && link.get("of") !== DATA.digest) {
            notes.push("The link is from another page; values that it does not set may differ.");
        }
        $("notes").textContent = notes.join(" ");
        this.begin(live, kept);
    }

    /** Shows the setting, and computes its response in the next frame. */
    refresh() {
        const {setting} = this.live, {fields} = DATA.kinds[setting.kind];
        $("kind").value = setting.kind;
        $("preset").value = DATA.presets.indexOf(setting.preset);
        $("preset-about").textContent = setting.preset?.about ?? "";
        $("file-row").hidden = setting.kind !== "csv";
        $("file-name").textContent = setting.file ? setting.file.title : "none chosen";
        this.drawing.show(setting);
        for (const control of this.controls) {
            control.show(setting);
            const [, field] = control.control.name.split("excitation.");
            if (field) control.row.hidden = !fields.includes(field);
        }
        for (const id of ["drop", "swap"]) $(id).disabled = !this.kept;
        $("keep").setAttribute("aria-pressed", String(this.kept !== null));
        cancelAnimationFrame(this.frame);
        clearTimeout(this.timer);
        this.background.end();
        this.frame = requestAnimationFrame(() => this.compute());
    }

    compute() {
        const problems = this.evaluate(this.live), ofKept = this.kept ? this.evaluate(this.kept) : [];
        const warnings = [...this.live.warnings ?? [], ...ofKept.map(problem => `A is not shown: ${problem}`)];
        this.showMessages(problems, warnings);
        for (const name of ["parameters", "inputs", "response"]) $(`save-${name}`).disabled = problems.length > 0;
        if (problems.length) return;
        for (const control of this.controls) control.widen(this.live.setting);
        DATA.panels.forEach((panel, number) => drawPanel(this.plots[number], panel, number, this.cases));
        this.mechanism.showResponse(this.live.run, this.live.setting.parameters);
        if (this.plane) drawPlane(this.plane, this.actuator, this.cases);
        drawFigures($("figures"), this.cases);
        if (this.loop) this.loop.draw(this.cases, $("loop-summary"));
        document.body.classList.add("waiting");
        this.timer = setTimeout(() => this.finish(), PAUSE);
    }

    /** Computes and stores the response of a case {setting} if it is missing; returns the messages of its problems. */
    evaluate(each) {
        if (each.problems) return each.problems;
        const {setting} = each, {parameters, unreadable} = setting;
        each.problems = unreadable.length ? unreadable : [...setting.problems, ...this.actuator.problems(parameters)];
        if (each.problems.length) return each.problems;
        try {
            each.run = this.actuator.run(setting, setting.excite());
            each.figures = figures(each.run);
            each.loop = DATA.linear && loopOf(this.actuator, setting);
            const clipping = clippingWarnings(setting, each.run.excitation);
            each.warnings = [...clipping, ...this.actuator.broken(parameters, true)];
        } catch (error) {
            each.problems = [error.message];
        }
        return each.problems;
    }

    showMessages(problems, warnings = []) {
        for (const [id, texts] of Object.entries({problems, warnings})) {
            $(id).replaceChildren(...texts.map(text => element("p", {}, text)));
        }
        document.body.classList.toggle("stale", problems.length > 0);
    }

    get cases() {
        return [...(this.kept?.run ? [["A", this.kept]] : []), ["B", this.live]];
    }

    /** Writes the settings to the page's address. Browsers limit the number of such changes. */
    writeLink() {
        const {live, kept} = this;
        const link = new URLSearchParams({of: DATA.digest, ...(kept ? {A: kept.setting} : {}), B: live.setting});
        for (const [name, setting] of [["A", kept?.setting], ["B", live.setting]]) {
            if (setting?.kind === "csv" && setting.file?.packed) link.set(`${name}.csv`, setting.file.packed);
        }
        history.replaceState(null, "", `#${link}`);
        this.hash = location.hash;
    }

    /** Writes link and texts and starts long computations, after a pause in the changes. */
    async finish() {
        this.writeLink();
        this.describe();
        try {
            for (const [, each] of this.cases) each.verdicts ??= await this.verdicts(each.setting);
            drawStrip($("verdicts"), $("verdict"), this.cases);
            drawRequirements($("requirements"), this.cases);
            for (const [, each] of this.cases) each.responses ??= await this.responses(each.setting);
            drawResponses(this.bode, this.cases);
            $("bode-summary").textContent = bodeSummary(this.cases);
            document.body.classList.remove("waiting");
        } catch ({message}) {  // the earlier results stay visible, but dimmed
            $("warnings").append(element("p", {}, `requirements and frequency responses are not computed: ${message}`));
        }
        document.body.dataset.ready = String(Number(document.body.dataset.ready ?? 0) + 1);
    }

    /** The verdicts on a setting by the requirements' names. */
    async verdicts(setting) {
        const measured = await this.background.ask("measured", setting);
        return new Map(JUDGED.map(requirement => [requirement.name, judged(requirement, measured)]));
    }

    /** The frequency responses of a setting, each as [label, response]. */
    async responses(setting) {
        return (await this.background.ask("responses", setting)).map(([[amplitude, load], response]) =>
            [withUnit(degrees(amplitude), "°") + (load ? `, ${withUnit(load, "N·m")}` : ""), response]);
    }

    /** Writes the response in words, for screen readers. */
    describe() {
        const listed = Object.entries(this.live.figures).filter(([name]) => DATA.headlines.includes(name));
        $("summary").textContent = listed.map(([name, value]) => `${words(name)} ${inUnit(name, value)}`).join(", ");
        DATA.panels.forEach((panel, k) => this.plots[k].describe(panel.names.map(name => {
            const column = this.live.run.outputs[name], [unit, factor] = panel.shown, last = column[column.length - 1];
            if (toWords(panel)) return `${words(name)} at the end ${toWords(panel)(last)}`;
            const [least, most, end] = [smallest(column), largest(column), last].map(x => withUnit(x / factor, unit));
            return `${words(name)} from ${least} to ${most}, at the end ${end}`;
        }).join("; ")));
    }

    /** The columns of a file of inputs: the excitation, and constant inputs that differ from their start values. */
    inputs() {
        const {setting, run: {excitation: {time, columns}}} = this.live;
        const changed = CONSTANT_INPUTS.filter(({name, start}) => setting.get(name) !== start);
        const constant = changed.map(({name}) => [name, time.map(() => Number(setting.get(name)))]);
        return {time, ...Object.fromEntries(constant), ...columns};
    }

    /** Saves a file of case B, even before its response is shown, unless it has problems. */
    save(name, text) {
        if (!this.evaluate(this.live).length) save(name, text());
    }

    async copyLink() {
        this.writeLink();
        try {
            await navigator.clipboard.writeText(location.href);
            const without = [this.kept, this.live].some(each =>
                each?.setting.kind === "csv" && !each.setting.file?.packed);
            $("copied").textContent = `link copied${without ? ", without the CSV file, which is too long for it" : ""}`;
        } catch {
            $("copied").textContent = "the link is the address of this page: copy it from the browser's address bar";
        }
    }
}

function save(name, text) {
    const blob = new Blob([text], {type: "text/plain"});
    const link = element("a", {href: URL.createObjectURL(blob), download: name});
    link.click();
    setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

const loaded = Actuator.load($("actuator").textContent.trim()).then(actuator => new Page(actuator), error => {
    $("problems").textContent = `This browser cannot run the page's actuator: ${error.message}`;
});
