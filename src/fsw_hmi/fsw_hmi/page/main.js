// Entry: the same page over a running weld or over recorded ones.
import { startBag } from "./bag.js";
import { startLive } from "./live.js";
import { meta } from "./dom.js";

const start = meta("source") === "bag" ? startBag : startLive;
document.body.classList.add(meta("source"));
start();
