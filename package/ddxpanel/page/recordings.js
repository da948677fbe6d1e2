// SPDX-License-Identifier: GPL-2.0-or-later
// Recordings: what there is; start, stop, split; copy to the USB stick, verify, download, delete.
import { armed, element, notice } from "./dom.js";
import { change, order } from "./robot.js";

const JOB_MS = 2000; // between looks at a job

function size(bytes) {
	return bytes < 1e9 ? `${Math.ceil(bytes / 1e6)} MB` : `${(bytes / 1e9).toFixed(1)} GB`;
}

function length(seconds) {
	const whole = Math.round(seconds), part = (value) => String(value).padStart(2, "0");
	return `${Math.floor(whole / 3600)}:${part(Math.floor(whole / 60) % 60)}:${part(whole % 60)}`;
}

function describe(one) {
	const lost = one.lost ? one.lost.store + one.lost.ring + one.lost.encode : null;
	return [one.utc ? one.utc.replace("T", " ").replace("Z", " UTC") : "time unknown", length(one.seconds), size(one.bytes),
		`${one.frames} frames`, lost === null ? null : `${lost} lost`].filter((text) => text).join(" · ");
}

// The copy or verification that is in progress, or the last one: it takes minutes, and goes on without this page.
function makeJob() {
	const line = element("p", { role: "status" }), said = element("p", { class: "dim" });
	const card = element("section", { class: "card", id: "job", hidden: true }, line, said);
	let runs = false, asked = 0;
	const stop = armed("Stop", "Stop: it is not finished then", async () => {
		const reason = await change(["job", "stop"]);
		if (reason) notice(reason, 20);
		await look();
	}, { id: "job-stop", hidden: true });
	card.append(stop);
	const draw = (found) => {
		const ended = found.status !== "", good = found.status === "0";
		runs = found.state === "running" && !ended;
		const words = found.words.replace(/^export /, "copy ").replace(/^verify$/, "verify all");
		line.textContent = runs ? `${words}: ${found.percent} %`
			: `${words}: ${good ? "good." : ended ? "FAILED." : "was interrupted."}`;
		line.className = runs ? "" : good ? "good" : "bad";
		said.textContent = found.said.join(" ");
		stop.hidden = !runs;
		card.hidden = false;
	};
	const look = async () => {
		asked = Date.now();
		const found = { said: [], words: "", percent: "", status: "" };
		await order(["job"], (text) => {
			const at = text.indexOf("="), key = text.slice(0, at), value = text.slice(at + 1);
			if (key === "said") found.said.push(value);
			else found[key] = value;
		});
		if (found.words) draw(found);
	};
	return { card, look, tick: () => { if (runs && Date.now() - asked >= JOB_MS) look(); } };
}

export function recordings(place) {
	const room = element("p", { class: "dim" }), list = element("div", {}, element("p", { class: "dim" }, "..."));
	const drawn = new Map(); // by name: what is shown, so that a button that waits for its second tap stays
	const job = makeJob();

	const say = async (words) => {
		const reason = await change(words);
		notice(reason || "done", reason ? 20 : 3);
		await refresh();
	};

	// A link, so that the browser writes the file as it comes, and goes on after an interruption.
	const downloads = (one) => one.files.map((file, at) =>
		element("a", { class: "button", href: `/panel/recording/${encodeURIComponent(file)}`, download: file },
			one.files.length === 1 ? "Download" : `Download ${at + 1} of ${one.files.length}`));

	const begin = async (words) => {
		const reason = await change(words);
		if (reason) notice(reason, 20);
		await job.look();
	};

	const card = (one) => {
		const runs = one.state === "recording", name = one.recording;
		const state = element("span", { class: runs ? "good" : one.state === "finished" ? "dim" : "bad" }, one.state);
		const button = (text, act) => element("button", { type: "button", onclick: act }, text);
		return element("section", { class: "card", id: `recording-${name}` },
			element("strong", {}, name), " ", state, element("p", { class: "dim" }, describe(one)),
			runs ? null : element("div", { class: "buttons" },
				button("Copy to stick", () => begin(["recordings", "copy", name, "usb"])),
				button("Verify", () => begin(["recordings", "verify", name])),
				...downloads(one),
				armed("Delete", `Delete ${name}: it cannot be fetched any more`, () => say(["recordings", "remove", name]))));
	};

	const refresh = async () => {
		await job.look();
		const said = [];
		const how = await order(["recordings"], (line) => said.push(line));
		if (how.end !== "exited" || how.status !== 0) {
			list.replaceChildren(element("p", { class: "bad" }, said.join(" ")));
			drawn.clear();
			return;
		}
		const found = said.map((line) => JSON.parse(line)).reverse();
		const cards = found.map((one) => {
			const text = one.state === "recording" ? JSON.stringify(one) : `${one.recording} ${one.state} ${one.bytes}`;
			const old = drawn.get(one.recording);
			if (old && old.text === text) return old.card;
			drawn.set(one.recording, { text, card: card(one) });
			return drawn.get(one.recording).card;
		});
		room.textContent = `${found.length} recordings, ${size(found.reduce((sum, one) => sum + one.bytes, 0))}`;
		if (cards.length !== list.children.length || cards.some((one, at) => list.children[at] !== one))
			list.replaceChildren(...cards);
	};

	const button = (text, act) => element("button", { type: "button", onclick: act }, text);
	place.replaceChildren(element("h2", {}, "Recordings"), room,
		element("div", { class: "buttons" }, button("Start", () => say(["record", "start"])),
			button("Split", () => say(["record", "split"])),
			armed("Stop", "Stop: nothing is recorded until the next start", () => say(["record", "stop"]), { id: "record-stop" })),
		element("p", { class: "dim" }, "Split finishes the recording in progress, so that it can be copied, and begins the next."),
		element("div", { class: "buttons" },
			button("Copy all to stick", () => begin(["recordings", "copy", "all", "usb"])),
			button("Verify all", () => begin(["recordings", "verify"]))),
		job.card, list);
	return { refresh, tick: () => job.tick(), every: 5 };
}
