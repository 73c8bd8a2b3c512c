// The WebSocket to `vgstereo view`: frames and status in, requests out.

const RETRY_MS = 1000;

const ARRAYS = { u8: Uint8Array, i16: Int16Array, u16: Uint16Array };

// A frame: the head of its message, with the planes by name, each with its values read in place.
export function decodeFrame(buffer) {
  const headBytes = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, headBytes));
  const frame = JSON.parse(text);
  const planes = {};
  for (const plane of frame.planes) {
    const count = plane.width * plane.height * plane.channels;
    planes[plane.name] = { ...plane, values: new ARRAYS[plane.kind](buffer, plane.offset, count) };
  }
  return { ...frame, planes };
}

// Connects, again whenever the connection is lost, and returns what sends a request. A request that
// cannot be sent is dropped: `onOpen` sends what must be known.
export function connect({ onOpen, onFrame, onStatus, onClose }) {
  let socket;
  const open = () => {
    socket = new WebSocket(`ws://${location.host}/live`);
    socket.binaryType = "arraybuffer";
    socket.onopen = onOpen;
    socket.onmessage = ({ data }) => {
      if (typeof data === "string") onStatus(JSON.parse(data));
      else onFrame(decodeFrame(data));
    };
    socket.onclose = () => {
      onClose();
      setTimeout(open, RETRY_MS);
    };
  };
  open();
  return (request) => {
    if (socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(request));
  };
}
