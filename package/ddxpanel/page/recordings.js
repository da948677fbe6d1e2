// SPDX-License-Identifier: GPL-2.0-or-later
// Recordings: what there is; start, stop, split; copy to the USB stick, verify, delete.
import { armed, element, notice } from "./dom.js";
import { Refused, change, order } from "./robot.js";

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

export function recordings(place) {
	const room = element("p", { class: "dim" }), list = element("div", {}, element("p", { class: "dim" }, "..."));
	const drawn = new Map(); // by name: what is shown, so that a button that waits for its second tap stays
	let busy = false; // a copy or a verification, one at a time

	const say = async (words) => {
		const reason = await change(words);
		notice(reason || "done", reason ? 20 : 3);
		await refresh();
	};

	// Takes minutes: its percents are shown, and then all that it said.
	const work = async (words, line) => {
		if (busy) {
			notice("another one is being copied or verified");
			return;
		}
		busy = true;
		const said = [];
		line.textContent = `${words[1]}: begins ...`;
		try {
			const how = await order(words, (text) => {
				if (/^\d+ %$/.test(text)) line.textContent = `${words[1]}: ${text}`;
				else said.push(text);
			});
			const good = how.end === "exited" && how.status === 0;
			line.textContent = `${words[1]}: ${good ? "good" : "FAILED"}. ${said.join(" ")}`;
			line.className = good ? "good" : "bad";
		} catch (error) {
			line.className = "bad";
			line.textContent = error instanceof Refused ? error.message : "the connection to the machine was lost";
		}
		busy = false;
	};

	const card = (one) => {
		const runs = one.state === "recording", name = one.recording, line = element("p", { role: "status" });
		const state = element("span", { class: runs ? "good" : one.state === "finished" ? "dim" : "bad" }, one.state);
		const button = (text, act) => element("button", { type: "button", onclick: act }, text);
		return element("section", { class: "card", id: `recording-${name}` },
			element("strong", {}, name), " ", state, element("p", { class: "dim" }, describe(one)),
			runs ? null : element("div", { class: "buttons" },
				button("Copy to stick", () => work(["recordings", "copy", name, "usb"], line)),
				button("Verify", () => work(["recordings", "verify", name], line)),
				armed("Delete", `Delete ${name}: it cannot be fetched any more`, () => say(["recordings", "remove", name]))),
			line);
	};

	const refresh = async () => {
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

	const button = (word, text) => element("button", { type: "button", onclick: () => say(["record", word]) }, text);
	place.replaceChildren(element("h2", {}, "Recordings"), room,
		element("div", { class: "buttons" }, button("start", "Start"), button("split", "Split"),
			armed("Stop", "Stop: nothing is recorded until the next start", () => say(["record", "stop"]), { id: "record-stop" })),
		element("p", { class: "dim" }, "Split finishes the recording in progress, so that it can be copied, and begins the next."),
		list);
	return { refresh, tick: () => {}, every: 5 };
}
