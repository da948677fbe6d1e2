// SPDX-License-Identifier: GPL-2.0-or-later
// Streams: those that the machine sends; one to this device, others of the technician's, and their files for players.
import { armed, element, notice } from "./dom.js";
import { Refused, change, order, session } from "./robot.js";

const PROGRAM = "ddxvideosend"; // the image's own stream; ddxvideosend.NAME are those that were added
const AGAIN_MS = 5000; // until the machine is asked again for a file that it does not have yet
const LONGEST = 39; // characters of an address; a service's name has 54 at most
const COST = "Each stream costs the machine processor time: remove those that are not watched.";

async function lines(words) {
	const said = [];
	const how = await order(words, (line) => said.push(line));
	if (how.end === "exited" && how.status === 0) return said;
	throw new Refused(0, said.join(" ").replace(/ddxctl: (stream: )?/g, "") || `${words.join(" ")}: ${how.end}`);
}

// The description of a stream (SDP), without what `ddxctl stream` says besides.
async function description(name) {
	return (await lines(["stream", name])).map((line) => line.trimEnd()).filter((line) => /^[a-z]=/.test(line));
}

function destination(sdp) {
	const value = (begin) => (sdp.find((line) => line.startsWith(begin)) || "").slice(begin.length);
	return `to ${value("c=IN ").replace(/^IP[46] /, "").replace(/\/.*/, "")}, port ${value("m=video ").split(" ")[0]}`;
}

// A description as soon as there is one; until then the line has the reason. Null: the line is not shown any more.
async function awaited(name, line) {
	while (line.isConnected) {
		try {
			const sdp = document.hidden ? null : await description(name);
			if (sdp) return line.isConnected ? sdp : null;
		} catch (error) {
			if (error instanceof Refused && error.status === 401) throw error;
			line.textContent = error instanceof Refused ? error.message : "no connection to the machine";
			line.className = "bad";
		}
		await new Promise((done) => { setTimeout(done, AGAIN_MS); });
	}
	return null;
}

// Shows where a stream goes, and a link that saves its file, in `place`.
async function offer(name, place) {
	const line = element("p", { class: "dim" }, "waits for the first picture ...");
	place.replaceChildren(line);
	const sdp = await awaited(name, line);
	if (!sdp) return;
	const file = URL.createObjectURL(new Blob([sdp.join("\r\n"), "\r\n"], { type: "application/sdp" }));
	place.replaceChildren(element("p", { class: "dim" }, destination(sdp)), element("div", { class: "buttons" },
		element("a", { class: "button main", href: file, download: `${name}.sdp` }, `Save ${name}.sdp`)),
		element("p", { class: "dim" }, "Open that file with VLC or another player on this device."));
}

function streamCard(one, say) {
	const file = element("div", {}), runs = one.state === "running", name = one.name;
	const button = (text, act) => element("button", { type: "button", onclick: act }, text);
	const consequence = name === PROGRAM ? "the operator sees nothing" : "its viewers see nothing";
	return element("section", { class: "card", id: `stream-${name}` },
		element("strong", {}, name), " ", element("span", { class: runs ? "good" : "dim" }, one.state), file,
		element("div", { class: "buttons" },
			runs ? button("File for players", () => offer(name, file)) : null,
			one.enabled ? armed("Switch off", `Switch off: ${consequence}`, () => say(["disable", name]))
				: button("Switch on", () => say(["enable", name])),
			name === PROGRAM ? null : armed("Remove", `Remove ${name}: ${consequence}`, () => say(["remove", name]))));
}

// A form for `ddxctl add`; an empty receiver means the multicast group.
function form(say) {
	const field = (id, label, attributes) => {
		const input = element("input", { id, autocomplete: "off", ...attributes });
		return { input, row: element("div", {}, element("label", { for: id }, label), input) };
	};
	const name = field("stream-name", "Name of the stream", { required: true, pattern: "[A-Za-z0-9_\\-]+" });
	const item = field("stream-item", "Video item", { value: "video", required: true });
	const to = field("stream-to", "Receiver's address; empty: multicast", { placeholder: "192.168.0.20" });
	const port = field("stream-port", "Port, even", { type: "number", min: 2, max: 65532, step: 2, value: 8000 });
	const ts = field("stream-ts", "Port of MPEG-TS for VLC, even; empty: none", { type: "number", min: 2, max: 65532, step: 2 });
	const made = element("form", {}, ...[name, item, to, port, ts].map(({ row }) => row),
		element("button", { class: "main" }, "Add"));
	made.addEventListener("submit", (event) => {
		event.preventDefault();
		const settings = [`name=${item.input.value.trim()}`];
		if (to.input.value.trim()) settings.push("group=none", `to=${to.input.value.trim()}`);
		if (port.input.value) settings.push(`port=${port.input.value}`);
		if (ts.input.value) settings.push(`ts=${ts.input.value}`);
		say(["add", `${PROGRAM}.${name.input.value.trim()}`, ...settings]);
	});
	return element("details", { id: "add-stream" }, element("summary", {}, "Add another stream"), made);
}

export function streams(place) {
	const list = element("div", {}, element("p", { class: "dim" }, "...")), file = element("div", { id: "watch-file" });
	const drawn = new Map(); // by name: what is shown, so that a button that waits for its second tap stays
	let known = [], watched = ""; // all streams; the name of the one whose file is offered above them

	const say = async (words) => {
		notice(`${words.join(" ")} ...`, 60);
		const reason = await change(words);
		notice(reason || "done", reason ? 20 : 3);
		if (!reason && words[0] === "remove" && words[1] === watched) file.replaceChildren();
		await refresh().catch(() => {}); // the list is asked for again in a moment
		return !reason;
	};

	const watch = async () => {
		const { address } = await session();
		if (/^fe80:/i.test(address)) {
			notice("open this page by the machine's IPv4 address: a stream cannot be sent to a link-local one", 20);
			return;
		}
		const device = address.replace(/[^0-9A-Za-z]/g, "-");
		const name = `${PROGRAM}.to${device.length < LONGEST ? "-" : ""}${device}`;
		const exists = known.some((one) => one.name === name);
		if (!exists && !await say(["add", name, "group=none", `to=${address}`])) return;
		watched = name;
		await offer(name, file);
	};

	const refresh = async () => {
		known = (await lines(["services"])).map((line) => JSON.parse(line))
			.filter(({ name }) => name === PROGRAM || name.startsWith(`${PROGRAM}.`));
		const cards = known.map((one) => {
			const text = `${one.state} ${one.enabled}`, old = drawn.get(one.name);
			if (old && old.text === text) return old.card;
			drawn.set(one.name, { text, card: streamCard(one, say) });
			return drawn.get(one.name).card;
		});
		if (cards.length !== list.children.length || cards.some((one, at) => list.children[at] !== one))
			list.replaceChildren(...cards);
	};

	place.replaceChildren(element("h2", {}, "Streams"), element("p", { class: "dim" }, COST),
		element("div", { class: "buttons" },
			element("button", { type: "button", class: "main", id: "watch", onclick: watch }, "Watch on this device")),
		file, list, form(say));
	return { refresh, tick: () => {}, every: 5 };
}
