// SPDX-License-Identifier: GPL-2.0-or-later
// The pages. Each has show(place), which fills the place and returns a function that refreshes it, with `every`, s.
import { age, armed, element, notice } from "./dom.js";
import { change, order } from "./robot.js";

const PURPOSES = {
	ddxstore: ["holds the pictures; everything else needs it", "no pictures and no recording"],
	ddxvideoV4L: ["takes pictures from the camera", "no pictures from the camera"],
	ddxvideo1394: ["takes pictures from an IIDC camera", "no pictures from that camera"],
	ddxvideosave: ["records", "nothing is recorded"],
	ddxvideosend: ["sends pictures to the operator", "the operator sees nothing"],
	ddxvideoplay: ["shows pictures on a screen of the machine", "no pictures on that screen"],
	ddxvideoSVS: ["range from a stereo pair", "no range"],
	ddxdecode: ["receives the stream of another robot", "that stream is not received"],
	ddxvideoload: ["plays a clip instead of a camera", "the clip stops"],
	ddxlog: ["logs all other values", "nothing is logged"],
	ddxcatalog: ["shows this machine's values to other machines", "other machines see no values"],
	ddxhealth: ["restarts programs that hang", "the watchdog resets the machine"],
	ddxpanel: ["this page", "this page goes away"],
};

// Instances are named after their program: ddxvideosend.rear.
function about(name) {
	return PURPOSES[name.split(".")[0]] || ["", `${name} stops`];
}

// ---- Answers that are shown at once when a page is opened again ----

const known = { health: null, services: null }; // { time, lines }

async function lines(words, take) {
	const found = [];
	await order(words, (line) => {
		found.push(JSON.parse(line));
		if (take) take(found);
	});
	return { time: Date.now(), lines: found };
}

export function forget() {
	known.health = known.services = null;
}

// ---- Health ----

function healthCard(line) {
	return element("section", { class: line.complaint ? "card complaint" : "card" },
		element("h3", {}, line.complaint ? `! ${line.title}` : line.title),
		element("p", {}, line.text),
		line.complaint && line.action ? element("p", { class: "action" }, line.action) : null);
}

function summary(found) {
	const count = found.lines.filter((line) => line.complaint).length;
	const text = count === 0 ? "All is well" : count === 1 ? "1 complaint" : `${count} complaints`;
	return element("h2", { class: count ? "bad" : "good" }, text);
}

function health(place) {
	const title = element("div", {}), when = element("p", { class: "dim" }), list = element("div", {});
	const draw = () => {
		if (!known.health) return;
		title.replaceChildren(summary(known.health));
		when.textContent = `checked ${age(known.health.time)}`;
		list.replaceChildren(...known.health.lines.map(healthCard));
	};
	place.replaceChildren(title, when, list, element("div", { class: "buttons" },
		element("button", { type: "button", onclick: () => refresh() }, "Check again")));
	draw();
	const refresh = async () => {
		when.textContent = known.health ? `checked ${age(known.health.time)}; checking ...` : "checking ...";
		const first = !known.health;
		known.health = await lines(["health"], (found) => {
			if (first) list.append(healthCard(found.at(-1)));
		});
		draw();
	};
	return { refresh, tick: () => { if (known.health) when.textContent = `checked ${age(known.health.time)}`; },
		every: 60 };
}

// ---- Services ----

async function act(words, done) {
	notice(`${words.join(" ")} ...`, 60);
	const reason = await change(words);
	notice(reason || "done", reason ? 20 : 3);
	await done();
}

function serviceCard(one, done) {
	const [purpose, consequence] = about(one.name);
	const running = one.state === "running" || one.state === "waiting";
	const wrong = one.state === "died" || one.state === "misconfigured";
	const attributes = { role: "switch", "aria-checked": one.enabled ? "true" : "false", "aria-label": one.name };
	const toggle = one.enabled
		? armed("On", `Switch off: ${consequence}`, () => act(["disable", one.name], done), attributes)
		: element("button", { type: "button", ...attributes, onclick: () => act(["enable", one.name], done) }, "Off");
	const buttons = element("div", { class: "buttons" },
		element("a", { class: "button", href: `#messages/${one.name}` }, "Messages"),
		one.enabled ? armed("Restart", `Restart: ${consequence} meanwhile`, () => act(["restart", one.name], done)) : null,
		running ? armed("Stop", `Stop until the next start: ${consequence}`, () => act(["stop", one.name], done)) : null,
		one.enabled && !running
			? element("button", { type: "button", onclick: () => act(["start", one.name], done) }, "Start") : null);
	const restarts = one.restarts ? `, started again ${one.restarts} times` : "";
	return element("section", { class: "card", id: `service-${one.name}` },
		element("div", { class: "row" },
			element("div", {}, element("strong", {}, one.name), " ",
				element("span", { class: wrong ? "bad" : running ? "good" : "dim" }, one.state + restarts),
				element("p", { class: "dim" }, purpose)),
			toggle),
		element("details", {}, element("summary", {}, "More"), buttons));
}

function services(place) {
	const when = element("p", { class: "dim" }), list = element("div", {});
	const drawn = new Map(); // by name: what is shown, so that a button that waits for its second tap stays
	const draw = () => {
		if (!known.services) return;
		when.textContent = age(known.services.time);
		const cards = known.services.lines.map((one) => {
			const text = JSON.stringify(one), old = drawn.get(one.name);
			if (old && old.text === text) return old.card;
			const card = serviceCard(one, refresh);
			if (old && old.card.querySelector("details").open) card.querySelector("details").open = true;
			drawn.set(one.name, { text, card });
			return card;
		});
		if (cards.length !== list.children.length || cards.some((card, at) => list.children[at] !== card))
			list.replaceChildren(...cards);
	};
	const refresh = async () => {
		known.services = await lines(["services"]);
		draw();
	};
	place.replaceChildren(element("h2", {}, "Services"), when, list);
	draw();
	return { refresh, tick: () => { if (known.services) when.textContent = age(known.services.time); }, every: 5 };
}

// ---- Messages ----

function messages(place, argument) {
	const name = argument || "ddxstore";
	const text = element("pre", {}, "..."), select = element("select", { id: "service", "aria-label": "Service" });
	const fill = () => {
		const names = (known.services ? known.services.lines.map((one) => one.name) : [name]).concat("lastboot");
		select.replaceChildren(...names.map((one) =>
			element("option", { value: one, selected: one === name }, one === "lastboot" ? "before the last reset" : one)));
	};
	select.addEventListener("change", () => { location.hash = `messages/${select.value}`; });
	const refresh = async () => {
		if (!known.services) known.services = await lines(["services"]);
		fill();
		const said = [];
		await order(["logs", name], (line) => said.push(line));
		text.textContent = said.length ? said.join("\n") : "no messages";
	};
	place.replaceChildren(element("h2", {}, "Messages"), element("div", { class: "row" }, select,
		element("button", { type: "button", onclick: () => refresh() }, "Refresh")), text);
	if (known.services) fill();
	return { refresh, tick: () => {}, every: 0 };
}

// ---- Report ----

function report(place) {
	const result = element("div", {});
	const button = element("button", { type: "button", class: "main" }, "Make the report");
	button.addEventListener("click", async () => {
		button.disabled = true;
		result.replaceChildren(element("p", { class: "dim" }, "takes some seconds ..."));
		const said = [];
		try {
			await order(["report"], (line) => said.push(line));
			const file = URL.createObjectURL(new Blob([said.join("\n"), "\n"], { type: "text/plain" }));
			result.replaceChildren(
				element("div", { class: "buttons" }, element("a", { class: "button", href: file,
					download: `${document.title}-report.txt` }, "Save it as a file")),
				element("pre", {}, said.join("\n")));
		} catch (error) {
			result.replaceChildren(element("p", { class: "bad" }, error.message));
		}
		button.disabled = false;
	});
	place.replaceChildren(element("h2", {}, "Report"),
		element("p", {}, "One text for the developers: health, services, counters and all messages, without passphrases "
			+ "and keys."), button, result);
	return { refresh: async () => {}, tick: () => {}, every: 0 };
}

// ---- Machine ----

function machine(place, words, gone) {
	const leave = (word, text) => async () => {
		const reason = await change(["machine", word]).catch(() => null); // the machine may be faster than its answer
		if (reason) notice(reason, 20);
		else gone(text);
	};
	const reset = async () => {
		notice("resets the settings ...", 300);
		const reason = await change(["reset", "settings"]);
		notice(reason || "done: the machine has the image's settings", reason ? 20 : 8);
	};
	place.replaceChildren(element("h2", {}, "Machine"),
		element("p", { class: "dim" }, "The recording in progress is finished first."),
		element("div", { class: "buttons" },
			armed("Restart", "Restart: no pictures and no recording for half a minute",
				leave("restart", "The machine restarts ..."), { id: "restart" }),
			armed("Reset settings", "Reset: all switching and added streams are undone, recordings stay; if the panel was switched "
				+ "on by ddxctl, this page goes away", reset, { id: "reset" }),
			armed("Power off", "Power off: a person must switch it on by hand",
				leave("off", "The machine is being switched off."), { id: "off" })));
	return { refresh: async () => {}, tick: () => {}, every: 0 };
}

// A view that most visits do not open has a file of its own, which is fetched when the view is opened. Its function
// draws the view, as those above do; its refresh waits for the file.
function fetched(load, every) {
	return (place, argument) => {
		let view = null;
		const waits = element("p", { class: "dim" }, "Loading ...");
		place.replaceChildren(waits);
		const drawn = load().then((draw) => { if (waits.isConnected) view = draw(place, argument); });
		return { refresh: async () => { await drawn; if (view) await view.refresh(); }, tick: () => {}, every };
	};
}

export const VIEWS = {
	health: ["Health", health],
	services: ["Services", services],
	picture: ["Picture", fetched(async () => {
		const { live } = await import("./live.js");
		return (place, item) => live(place, item || "video");
	}, 5)],
	recordings: ["Recordings", fetched(async () => (await import("./recordings.js")).recordings, 5)],
	streams: ["Streams", fetched(async () => (await import("./streams.js")).streams, 5)],
	messages: ["Messages", messages],
	report: ["Report", report],
	machine: ["Machine", machine],
};
