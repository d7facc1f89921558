// What a rater does on a page: enlarge pictures, change views, choose by keyboard or mouse, send the answers.
"use strict";
(() => {
  const page = document.querySelector("main");
  const large = document.getElementById("large");
  const shown = performance.now();

  function visiblePicture(button) {
    return button.querySelector("img:not([hidden])");
  }

  function enlarge(button) {
    const source = visiblePicture(button), target = large.querySelector("img");
    target.src = source.src;
    target.alt = source.alt;
    large.showModal();
  }

  document.querySelectorAll("[data-enlarge]").forEach(button => button.addEventListener("click", () => enlarge(button)));
  large.querySelector("img").addEventListener("click", () => large.close());

  // A button that was clicked with the mouse does not keep the keys: Enter goes on, and presses no button again.
  let byMouse = false;
  document.addEventListener("click", event => {
    byMouse = event.detail > 0;
    if (byMouse) event.target.closest("button")?.blur();
  });
  large.addEventListener("close", () => { if (byMouse) document.activeElement?.blur(); });

  if (page.dataset.page === "introduction") {
    page.dataset.ready = "yes";
    document.addEventListener("keydown", event => {
      if (event.key === "Enter" && !large.open && !event.target.closest("button, a")) document.getElementById("continue").click();
    });
    return;
  }

  const form = document.getElementById("questions");
  const questions = [...form.querySelectorAll("fieldset")];
  const submit = form.querySelector("button[type=submit]");
  const problem = document.getElementById("problem");
  const views = [...document.querySelectorAll("[data-view]")];
  const seen = new Set([0]);
  let active = 0, view = 0, sending = false;

  function focusQuestion(number) {
    active = Math.max(0, Math.min(questions.length - 1, number));
    questions.forEach((one, index) => one.classList.toggle("active", index === active));
  }

  function unanswered() {
    return questions.findIndex(one => !one.querySelector("input:checked"));
  }

  // A page is complete once each view was looked at and each question is answered.
  function incomplete() {
    return unanswered() >= 0 || seen.size < views.length;
  }

  function refresh() {
    submit.disabled = sending || incomplete();
    problem.textContent = unanswered() < 0 && seen.size < views.length ? "Look at each view first." : "";
  }

  function choose(side) {
    questions[active].querySelector(`input[value=${side}]`).checked = true;
    if (active + 1 < questions.length) focusQuestion(active + 1);
    refresh();
  }

  function showView(number) {
    view = number % views.length;
    seen.add(view);
    document.dispatchEvent(new Event("pictures"));
    views.forEach((one, index) => one.setAttribute("aria-pressed", String(index === view)));
    document.querySelectorAll("figure[data-side] .picture").forEach(button => {
      button.querySelectorAll("img").forEach((image, index) => { image.hidden = index !== view; });
    });
    refresh();
  }

  async function send() {
    if (sending || incomplete()) return;
    sending = true;
    refresh();
    const answers = Object.fromEntries(new FormData(form));
    const body = JSON.stringify({ item: page.dataset.item, seconds: (performance.now() - shown) / 1000, ...answers });
    try {
      const reply = await fetch(`${page.dataset.base}/votes`, { method: "POST", headers: { "Content-Type": "application/json" }, body });
      if (reply.ok) {
        location.replace((await reply.json()).next);
        return;
      }
      if (reply.status === 409) {
        location.replace(page.dataset.base);
        return;
      }
      failed("Your answer is not saved yet: the study could not keep it. Press Next to try again.");
    } catch {
      failed("Your answer is not saved yet: the study does not answer. Press Next to try again in a moment.");
    }
  }

  function failed(words) {
    sending = false;
    refresh();
    problem.textContent = words;
  }

  form.addEventListener("submit", event => { event.preventDefault(); send(); });
  form.addEventListener("change", event => {
    focusQuestion(questions.indexOf(event.target.closest("fieldset")));
    const next = unanswered();
    if (next >= 0) focusQuestion(next);
    refresh();
  });
  views.forEach((button, index) => button.addEventListener("click", () => showView(index)));

  const actions = {
    1: () => choose("left"), ArrowLeft: () => choose("left"),
    2: () => choose("right"), ArrowRight: () => choose("right"),
    ArrowUp: () => focusQuestion(active - 1), ArrowDown: () => focusQuestion(active + 1),
    v: () => views.length && showView(view + 1), Enter: send,
    d: () => document.querySelector("[data-three]")?.click(),
  };

  document.addEventListener("keydown", event => {
    if (large.open || event.ctrlKey || event.metaKey || event.altKey || event.repeat) return;
    if (event.key === "Enter" && event.target.closest("button")) return;
    const action = actions[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (!action) return;
    event.preventDefault();
    action();
  });

  focusQuestion(Math.max(0, unanswered())); // something may be chosen before this script has come
  refresh();
  page.dataset.ready = "yes";
})();
