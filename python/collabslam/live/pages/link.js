// What both pages share: the secure socket with its token, the picture, the table of facts.
export const token = new URLSearchParams(location.hash.slice(1)).get("t") || "";

export function say(text, good) {
  const place = document.getElementById("said");
  place.textContent = text;
  place.className = "state " + (good ? "good" : "bad");
}

// Opens the socket, and again when it is lost; take(message) is given objects, picture(blob) images.
export function connect(role, hello, take, closed) {
  let wait = 250;
  const open = () => {
    const socket = new WebSocket(`wss://${location.host}/${role}`);
    socket.binaryType = "arraybuffer";
    socket.onopen = () => { wait = 250; socket.send(JSON.stringify({ token, ...hello() })); };
    socket.onmessage = (message) => {
      if (typeof message.data === "string") take(JSON.parse(message.data), socket);
      else picture(message.data);
    };
    socket.onclose = (event) => {
      closed();
      if (event.code === 1008) { say(event.reason || "refused", false); return; }
      say("no connection, trying again", false);
      setTimeout(open, wait);
      wait = Math.min(2 * wait, 4000);
    };
  };
  open();
}

let shown = "";
function picture(data) {
  const url = URL.createObjectURL(new Blob([data], { type: "image/jpeg" }));
  document.getElementById("view").src = url;
  if (shown) URL.revokeObjectURL(shown);
  shown = url;
}

export function facts(values) {
  const rows = Object.entries(values).map(([name, value]) => {
    const row = document.createElement("tr");
    for (const text of [name, value]) row.appendChild(document.createElement("td")).textContent = text;
    return row;
  });
  document.getElementById("facts").replaceChildren(...rows);
}
