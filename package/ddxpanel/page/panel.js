// SPDX-License-Identifier: GPL-2.0-or-later
// The page itself: login, choice of the page, and when it is refreshed.
import { element, notice } from "./dom.js";
import { Refused, logIn, logOut, session } from "./robot.js";
import { VIEWS, forget } from "./views.js";

const view = document.getElementById("view"), pages = document.getElementById("pages");
const logout = document.getElementById("logout");
const TOKEN = /^#[0-9a-f]{32}$/; // of a link, used up at once
let shown = null; // { refresh, tick, every, next } of the page that is shown

function title(name) {
	document.title = name;
	document.getElementById("name").textContent = name;
}

// ---- Login ----

function loginPage(text) {
	shown = null;
	forget();
	pages.hidden = logout.hidden = true;
	const field = element("input", { id: "passphrase", type: "password", autocomplete: "current-password",
		required: true });
	const button = element("button", { class: "main" }, "Log in");
	const said = element("p", { id: "said", role: "alert" }, text || "");
	const form = element("form", {}, element("label", { for: "passphrase" }, "Passphrase"), field, button, said,
		element("p", { class: "dim" }, "It is the line panel= of ddx.txt on the machine's card. Without such a line, "
			+ "ddxctl panel login prints a link on the machine."));
	form.addEventListener("submit", async (event) => {
		event.preventDefault();
		button.disabled = true;
		try {
			await enter(field.value, said);
		} catch (error) {
			said.textContent = `no answer: ${error.message}`;
		}
		button.disabled = false;
	});
	view.replaceChildren(form);
	field.focus();
}

async function enter(secret, said) {
	const { status, wait } = await logIn(secret);
	if (status === 200) {
		begin(await session());
		return;
	}
	const seconds = Math.max(1, Math.ceil(wait / 1000));
	said.textContent = status === 401 ? `Wrong. Try again in ${seconds} s.` : `Too early. Try again in ${seconds} s.`;
}

// ---- Pages ----

async function refresh() {
	const page = shown;
	if (!page || page.busy) return;
	page.busy = true;
	page.next = Date.now() + page.every * 1000;
	try {
		await page.refresh();
	} catch (error) {
		if (page === shown) failed(error);
	}
	page.busy = false;
}

function failed(error) {
	if (error instanceof Refused && error.status === 401) loginPage("Log in again: the session is over.");
	else notice(error instanceof Refused ? error.message : "no connection to the machine", 20);
}

function gone(text) {
	shown = null;
	pages.hidden = logout.hidden = true;
	view.replaceChildren(element("h2", {}, text), element("p", { class: "dim" },
		"This page comes back with the machine."));
	const look = setInterval(async () => {
		try {
			await session();
		} catch (error) {
			if (!(error instanceof Refused)) return;
		}
		clearInterval(look);
		location.reload();
	}, 5000);
}

// The text of a part of the address, which a visitor may have typed.
function plain(text) {
	try {
		return decodeURIComponent(text);
	} catch {
		return "";
	}
}

function choose() {
	if (pages.hidden) return;
	const [wanted, argument] = location.hash.slice(1).split("/").map(plain);
	const name = Object.hasOwn(VIEWS, wanted) ? wanted : "health";
	for (const link of pages.children)
		if (link.hash === `#${name}`) link.setAttribute("aria-current", "page");
		else link.removeAttribute("aria-current");
	shown = { busy: false, ...VIEWS[name][1](view, argument, gone) };
	view.focus();
	refresh();
}

function begin({ name }) {
	title(name);
	pages.hidden = logout.hidden = false;
	pages.replaceChildren(...Object.entries(VIEWS).map(([key, [text]]) => element("a", { href: `#${key}` }, text)));
	choose();
}

logout.addEventListener("click", async () => {
	await logOut().catch(() => {});
	loginPage("Logged out.");
});
addEventListener("hashchange", () => {
	if (TOKEN.test(location.hash)) location.reload();
	else choose();
});
// A rejected order of a button is reported like that of a page.
addEventListener("unhandledrejection", (event) => {
	event.preventDefault();
	failed(event.reason);
});
setInterval(() => {
	if (!shown || document.hidden) return;
	shown.tick();
	if (shown.every && Date.now() >= shown.next) refresh();
}, 1000);
document.addEventListener("visibilitychange", () => {
	if (!document.hidden && shown && shown.every) refresh();
});

async function start() {
	const token = TOKEN.test(location.hash) ? location.hash.slice(1) : "";
	if (token) {
		history.replaceState(null, "", "/");
		const { status } = await logIn(token);
		if (status !== 200) {
			loginPage("This link does not work any more: it works once, within two minutes.");
			return;
		}
	}
	try {
		begin(await session());
	} catch (error) {
		if (error instanceof Refused && error.status === 401) loginPage("");
		else view.replaceChildren(element("p", { class: "bad" }, error.message));
	}
}

start();
