// A browser starts no worker for a page that was opened from disk; an iframe runs the same script.
// Material's search uses only these members of Worker (what its package iframe-worker does).
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.append(frame) // loads nothing, and says so at once
      this.loaded = new Promise(resolve => frame.addEventListener("load", resolve))
      this.inside = frame.contentWindow
      this.inside.postMessage = data => this.dispatchEvent(new MessageEvent("message", {data}))
      this.inside.document.write(`<script src="${url}"></script>`)
      this.inside.document.close()
    }

    postMessage(data) {
      this.loaded.then(() => this.inside.dispatchEvent(new MessageEvent("message", {data})))
    }
  }
}
