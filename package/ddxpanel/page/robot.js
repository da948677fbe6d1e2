// SPDX-License-Identifier: GPL-2.0-or-later
// What the page asks of the machine.

export class Refused extends Error {
	constructor(status, text) {
		super(text);
		this.status = status; // as of HTTP
	}
}

function post(path, body) {
	return fetch(`/panel/${path}`, { method: "POST", headers: { "X-Panel": "1" }, body });
}

// The machine's name, and this device's address there; Refused with 401: not logged in.
export async function session() {
	const answer = await fetch("/panel/session");
	const text = (await answer.text()).trim();
	if (!answer.ok) throw new Refused(answer.status, text);
	const [name, address] = text.split("\n");
	return { name, address: address.replace(/^::ffff:/, "") };
}

// Status, and ms until this address may try again.
export async function logIn(secret) {
	const answer = await post("login", secret);
	if (![200, 401, 429].includes(answer.status)) throw new Refused(answer.status, (await answer.text()).trim());
	return { status: answer.status, wait: (await answer.json()).wait };
}

export function logOut() {
	return post("logout", "");
}

// The next picture of an item after this one, in this form ({ quality, divisor }). sequence: null if there is none yet.
export async function picture(item, after, { quality, divisor }) {
	const query = `after=${after}&quality=${quality}&divisor=${divisor}`;
	const answer = await fetch(`/panel/picture/${encodeURIComponent(item)}?${query}`);
	if (!answer.ok) throw new Refused(answer.status, (await answer.text()).trim());
	const number = (name) => Number(answer.headers.get(name));
	return { sequence: answer.status === 200 ? number("X-Sequence") : null, frame: number("X-Frame"), age: number("X-Age"),
		lost: number("X-Lost"), waited: number("X-Waited"), body: () => answer.blob() };
}

// Execute an order; each line of its output goes to take() as it comes. How it ended: { end: "exited", status: 0 }. The
// last line is the panel's; a line that looks like it but is followed by another one is the program's.
export async function order(words, take = () => {}) {
	const answer = await post("order", words.join("\n"));
	if (!answer.ok) throw new Refused(answer.status, (await answer.text()).trim());
	const reader = answer.body.pipeThrough(new TextDecoderStream()).getReader();
	let rest = "", last = null;
	for (;;) {
		const { value, done } = await reader.read();
		if (done) break;
		const lines = (rest + value).split("\n");
		rest = lines.pop();
		for (const line of lines) {
			if (last !== null) take(last);
			last = line.startsWith('{"end":') ? line : null;
			if (last === null) take(line);
		}
	}
	if (last === null) throw new Refused(0, "the answer is incomplete");
	return JSON.parse(last);
}

// Execute an order that only says how it went; a reason if it failed, else null.
export async function change(words) {
	const said = [];
	const how = await order(words, (line) => said.push(line));
	if (how.end === "exited" && how.status === 0) return null;
	const reason = said.join(" ").trim().replace(/^ddxctl: /, "");
	return reason || `${words.join(" ")}: ${how.end}, ${how.status}`;
}
