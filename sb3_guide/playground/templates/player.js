"use strict";
const { scenes, pictures } = JSON.parse(document.getElementById("data").textContent);
const PACE = 700; // milliseconds a step
const [scenePicker, timePicker, backButton, stepButton, playButton, seats] =
  ["scene", "time", "back", "step", "play", "seats"].map((id) => document.getElementById(id));
let scene = 0, time = 0, timer = null;

function element(tag, classes, ...children) {
  const made = document.createElement(tag);
  made.className = classes;
  made.append(...children);
  return made;
}

function percent(share) {
  return share > 0 && share < 0.005 ? "<1\u00a0%" : `${Math.round(100 * share)}\u00a0%`;
}

function share(classes, text, value) {
  const bar = element("i", "");
  bar.style.setProperty("--part", `${100 * value}%`);
  return element("span", `share ${classes}`, element("span", "what", text), element("span", "", percent(value)), bar);
}

function row(line) {
  const states = ["spoken", "told", "differs"].filter((state) => line[state]);
  const word = element("span", "word", element("b", "", line.message), element("small", "", line.meaning));
  const who = line.told ? "you" : line.spoken ? "Guide" : "";
  const made = element("div", ["message", ...states].join(" "), word, share("says", who, line.says), share("does", line.action, line.does));
  made.title = `If it heard ${line.message}: ${line.chances}`;
  return made;
}

function picture(index, caption, alt) {
  const image = element("img", "");
  image.src = pictures[index];
  image.alt = alt;
  return element("figure", "", image, element("figcaption", "", caption));
}

function panel(seat) {
  const now = Math.min(time, seat.moments.length - 1), moment = seat.moments[now];
  const head = ["Message, and what it means", "The Guide says it", "If heard, the agent chooses"];
  const speech = element("p", "", ...moment.speech.map((part) => element("span", part.who, part.text)));
  speech.setAttribute("aria-live", "polite");
  const turns = seat.turns.map((turn, at) =>
    element("li", [turn.by_person && "by-you", at === now && "now"].filter(Boolean).join(" "), turn.text));
  return element("section", "seat",
    element("header", "",
      element("h2", "", seat.agent, element("span", "soft", seat.kind)),
      element("p", "mission", moment.mission), element("p", "soft", moment.status)),
    element("div", seat.layout,
      picture(moment.world, seat.captions.world, "the world"),
      picture(moment.view, seat.captions.view, "the view of the agent")),
    element("div", "speech", speech,
      element("div", "messages", element("div", "head", ...head.map((text) => element("span", "", text))), ...moment.lines.map(row))),
    element("ol", "past", ...turns));
}

function last() {
  return Math.max(...scenes[scene].map((seat) => seat.turns.length));
}

function show() {
  seats.className = scenes[scene].length > 1 ? "seats two" : "seats";
  seats.replaceChildren(...scenes[scene].map(panel));
  scenePicker.value = scene;
  timePicker.max = last();
  timePicker.value = time;
  backButton.disabled = time === 0;
  stepButton.disabled = time === last();
  playButton.textContent = timer === null ? "Play" : "Pause";
  history.replaceState(null, "", `#${scene + 1}.${time}`);
}

function go(to) {
  time = Math.min(Math.max(to, 0), last());
  if (time === last()) pause();
  show();
}

function pause() {
  clearInterval(timer);
  timer = null;
}

function playOrPause() {
  if (timer !== null) pause();
  else {
    if (time === last()) time = 0;
    timer = setInterval(() => go(time + 1), PACE);
  }
  show();
}

function choose(index) {
  pause();
  scene = (index + scenes.length) % scenes.length;
  go(0);
}

scenePicker.append(...scenes.map((seats_, index) => {
  const { moments } = seats_[0], { mission, outcome } = moments.at(-1);
  const end = outcome ? `${outcome} after ${moments.length - 1} steps` : "not finished";
  const option = element("option", "", `${index + 1}. ${seats_.map((seat) => seat.agent).join(" and ")}: ${mission} (${end})`);
  option.value = index;
  return option;
}));
scenePicker.addEventListener("change", () => choose(Number(scenePicker.value)));
timePicker.addEventListener("input", () => { pause(); go(Number(timePicker.value)); });
backButton.addEventListener("click", () => { pause(); go(time - 1); });
stepButton.addEventListener("click", () => { pause(); go(time + 1); });
playButton.addEventListener("click", playOrPause);
document.addEventListener("keydown", (event) => {
  if (event.ctrlKey || event.altKey || event.metaKey || ["INPUT", "SELECT"].includes(event.target.tagName)) return;
  const uses = {
    ArrowRight: () => { pause(); go(time + 1); }, ArrowLeft: () => { pause(); go(time - 1); },
    p: playOrPause, n: () => choose(scene + 1), r: () => choose(scene),
  };
  uses[event.key]?.();
});

const [, sceneAtFirst, timeAtFirst] = /^#(\d+)\.(\d+)$/.exec(location.hash) ?? [0, 1, 0];
scene = Math.min(Math.max(Number(sceneAtFirst) - 1, 0), scenes.length - 1);
go(Number(timeAtFirst));
