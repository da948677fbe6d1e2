// SPDX-License-Identifier: GPL-2.0-or-later
// The live picture: one JPEG after another. While one is on its way, the next one is asked for already; nothing queues.
import { element } from "./dom.js";
import { Refused, order, picture } from "./robot.js";

// From the best one on; a picture shall take at most SLOW ms.
const FORMS = [[3, 1], [6, 1], [10, 1], [16, 1], [10, 2], [16, 2]].map(([quality, divisor]) => ({ quality, divisor }));
const FIRST = 1, SLOW = 100, FAST = 25;
const OLD_MS = 1000; // older pictures are grey
const RATE_MS = 2000; // over which the rate is counted

// Which form the next picture has, by the time that the former ones took.
function makeChoice() {
	let at = FIRST, fast = 0, wanted = 20, mean = null;
	return {
		form: () => FORMS[at],
		took(ms) {
			mean = mean === null ? ms : mean + (ms - mean) / 4;
			fast = ms < FAST ? fast + 1 : 0;
			if (mean > SLOW && at < FORMS.length - 1) {
				at++;
				wanted = Math.min(2 * wanted, 640); // what was too slow once is not tried often
			} else if (fast >= wanted && at > 0) {
				at--;
			} else {
				return;
			}
			mean = null;
			fast = 0;
		},
		tooLarge() {
			if (at < FORMS.length - 1) at++;
		},
	};
}

function makeScreen() {
	const canvas = element("canvas", { id: "picture", role: "img", "aria-label": "live picture" });
	const line = element("p", { id: "state", class: "dim" }, "no picture yet"), figure = element("figure", {}, canvas, line);
	let shown = null, times = [], refusal = "";
	const describe = () => {
		const now = performance.now();
		times = times.filter((time) => now - time < RATE_MS);
		const age = shown ? now - shown.taken : Infinity;
		figure.classList.toggle("old", age > OLD_MS);
		if (refusal) line.textContent = refusal;
		else if (shown && age > OLD_MS)
			line.textContent = `frame ${shown.frame} · old: no new picture for ${(age / 1000).toFixed(0)} s`;
		else if (shown)
			line.textContent = `frame ${shown.frame} · ${(times.length * 1000 / RATE_MS).toFixed(0)} a second · `
				+ `${shown.lost} lost · ${Math.round(age)} ms old · ${canvas.width}x${canvas.height}, q ${shown.form.quality}`;
	};
	return {
		figure,
		describe,
		refuse(text) {
			refusal = text;
			describe();
		},
		// False: it is not newer than the one that is shown.
		draw(next, bitmap) {
			if (shown && next.turn < shown.turn) return;
			shown = next;
			refusal = "";
			canvas.width = bitmap.width;
			canvas.height = bitmap.height;
			canvas.getContext("2d").drawImage(bitmap, 0, 0);
			canvas.dataset.frame = next.frame;
			times.push(performance.now());
			describe();
		},
	};
}

// Asks for pictures of an item as long as the screen is part of the page. `failed` is called once, with an error.
function follow(item, screen, failed) {
	const choice = makeChoice();
	let after = 0, open = 0, asking = false, turn = 0, pause = 0, idle = 0; // idle: since when the link has been
	const lives = () => screen.figure.isConnected && !document.hidden && Date.now() >= pause;

	async function one() {
		const mine = turn++, form = choice.form(), asked = performance.now();
		const answer = await picture(item, after, form);
		after = answer.sequence ?? after;
		asking = false;
		next(); // its headers are here: while its bytes are on their way, the next one may be made
		if (answer.sequence === null) return;
		const blob = await answer.body();
		// Not from the headers on: they come with the first bytes of the picture, in one TLS record of up to 16 KB.
		const begun = Math.max(idle, asked + answer.waited);
		idle = performance.now();
		choice.took(idle - begun);
		const bitmap = await createImageBitmap(blob);
		// The machine's age, and all the time since the request in which the machine was not waiting for a frame.
		screen.draw({ turn: mine, frame: answer.frame, lost: answer.lost, form,
			taken: asked + answer.waited - answer.age }, bitmap);
		bitmap.close();
	}

	function next() {
		if (asking || open >= 2 || !lives()) return;
		asking = true;
		open++;
		one().catch((error) => {
			if (error instanceof Refused && error.status === 401) failed(error);
			else if (error instanceof Refused && error.status === 413) choice.tooLarge();
			else screen.refuse(error instanceof Refused ? error.message : "no connection to the machine");
			pause = Date.now() + 1000;
			asking = false;
		}).finally(() => {
			open--;
			next();
		});
	}
	return next;
}

export function live(place, item) {
	const select = element("select", { id: "item", "aria-label": "Item" }, element("option", { value: item }, item));
	const screen = makeScreen();
	let failure = null;
	const next = follow(item, screen, (error) => { failure = error; });
	select.addEventListener("change", () => { location.hash = `picture/${encodeURIComponent(select.value)}`; });
	const timer = setInterval(() => {
		if (!screen.figure.isConnected) {
			clearInterval(timer);
			return;
		}
		screen.describe();
		next();
	}, 100);
	const refresh = async () => {
		if (failure) throw failure;
		const said = [];
		await order(["items"], (line) => said.push(line));
		const found = JSON.parse(said.join("")).items.filter((one) => one.type === "DDX_VIDEO").map((one) => one.name);
		const names = found.includes(item) ? found : [item, ...found];
		const options = [...select.options].map((one) => one.value);
		if (names.join("\n") !== options.join("\n"))
			select.replaceChildren(...names.map((one) => element("option", { value: one, selected: one === item }, one)));
	};
	place.replaceChildren(element("h2", {}, "Picture"), select, screen.figure);
	next();
	return { refresh, tick: () => {}, every: 5 };
}
