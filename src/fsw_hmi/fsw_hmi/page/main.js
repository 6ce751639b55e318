// Entry: the same page over a running weld or over recorded ones.
import { startBag } from "./bag.js";
import { LivePage } from "./live.js";
import { meta } from "./dom.js";

document.body.classList.add(meta("source"));
if (meta("source") === "bag") startBag();
else new LivePage().connection.start();
