export function startBag() {}
