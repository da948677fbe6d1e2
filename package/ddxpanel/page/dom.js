// SPDX-License-Identifier: GPL-2.0-or-later
// Elements of the page. Texts are inserted as text, never as HTML: messages and names may contain anything.

// An element; attributes whose names begin with "on" are listeners, true and false switch an attribute on and off.
export function element(name, attributes = {}, ...children) {
	const made = document.createElement(name);
	for (const [key, value] of Object.entries(attributes)) {
		if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
		else if (value === true) made.setAttribute(key, "");
		else if (value !== false && value !== null) made.setAttribute(key, value);
	}
	made.append(...children.filter((child) => child !== null));
	return made;
}

const ARMED_MS = 6000;

// A button that acts on its second tap: after the first one it names the consequence.
export function armed(label, consequence, act, attributes = {}) {
	const button = element("button", { type: "button", ...attributes }, label);
	let timer = 0;
	const disarm = () => {
		clearTimeout(timer);
		timer = 0;
		button.textContent = label;
		button.classList.remove("danger");
	};
	button.addEventListener("click", () => {
		if (timer) {
			disarm();
			act();
			return;
		}
		button.textContent = consequence;
		button.classList.add("danger");
		timer = setTimeout(disarm, ARMED_MS);
	});
	return button;
}

let timer = 0;

// A line at the bottom of the page, for some seconds; empty: away.
export function notice(text, seconds = 8) {
	clearTimeout(timer);
	const line = document.getElementById("notice");
	line.textContent = text;
	if (text) timer = setTimeout(() => { line.textContent = ""; }, seconds * 1000);
}

export function age(time) {
	const seconds = Math.round((Date.now() - time) / 1000);
	if (seconds < 3) return "now";
	return seconds < 120 ? `${seconds} s ago` : `${Math.round(seconds / 60)} min ago`;
}
