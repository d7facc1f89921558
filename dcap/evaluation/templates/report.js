// Filters, views and folded pictures of a run's page; without it everything is shown.
"use strict";
(() => {
  const bar = document.querySelector(".choices");
  const all = selector => [...document.querySelectorAll(selector)];
  const chosen = name => bar.querySelector(`[name=${name}]`)?.value ?? "";
  const holds = (cell, one) => (!one.verdict || cell.dataset.kind === one.verdict) && (!one.support || cell.dataset.support === one.support)
    && (!one.fault || (one.fault === "any" ? cell.dataset.marks : cell.dataset.marks.split("|").includes(one.fault)));

  function filter() {
    const one = Object.fromEntries(["method", "verdict", "support", "fault"].map(name => [name, chosen(name)]));
    const words = chosen("words").trim().toLowerCase();
    let shown = 0;
    const cards = all("article.card");
    for (const card of cards) {
      const cells = card.dataset.kind === undefined ? [...card.querySelectorAll("[data-kind]")] : [card];
      let fits = false;
      for (const cell of cells) {
        const own = !one.method || cell.dataset.method === one.method;
        if (cell !== card) cell.hidden = !own;
        fits ||= own && holds(cell, one);
      }
      for (const more of card.querySelectorAll("[data-of]")) more.hidden = Boolean(one.method) && more.dataset.of !== one.method;
      card.hidden = !fits || !card.dataset.words.toLowerCase().includes(words);
      shown += !card.hidden;
    }
    for (const fault of all(".fault")) fault.hidden = Boolean(one.method) && fault.dataset.method !== one.method;
    bar.querySelector("output").value = `${shown} of ${cards.length} samples`;
  }

  function show(view) {
    for (const picture of all("img[data-views]")) {
      if (!picture.dataset.views.split("|").includes(view)) continue;
      picture.src = picture.parentElement.href = `${picture.dataset.folder}/${view}`;
    }
  }

  // All views of all methods side by side, made when they are asked for.
  function spread(folded) {
    const place = folded.querySelector(".all-views");
    if (!folded.open || place.childElementCount) return;
    const pictures = [...folded.closest("article").querySelectorAll("img[data-views]")];
    const views = [...new Set(pictures.flatMap(one => one.dataset.views.split("|")))];
    place.style.gridTemplateColumns = `max-content repeat(${pictures.length}, minmax(120px, 1fr))`;
    place.append(document.createElement("span"), ...pictures.map(one => Object.assign(document.createElement("b"), { textContent: one.dataset.name })));
    for (const view of views) {
      place.append(Object.assign(document.createElement("span"), { textContent: view.replace(/^views\/|\.png$/g, "") }));
      for (const one of pictures) {
        const has = one.dataset.views.split("|").includes(view), link = document.createElement(has ? "a" : "span");
        if (has) {
          link.href = `${one.dataset.folder}/${view}`;
          link.append(Object.assign(new Image(), { loading: "lazy", src: link.href, alt: `${one.dataset.name}, ${view}` }));
        }
        place.append(link);
      }
    }
  }

  bar.hidden = false;
  bar.addEventListener("input", event => (event.target.name === "view" ? show(event.target.value) : filter()));
  for (const folded of all("details.spread")) folded.addEventListener("toggle", () => spread(folded));
  filter();
})();
