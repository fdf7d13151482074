<!DOCTYPE qgis PUBLIC 'http://mrcc.com/qgis.dtd' 'SYSTEM'>
<!-- Outline of each field with its name. -->
<qgis version="3.34.0" styleCategories="Symbology|Labeling|MapTips" labelsEnabled="1">
 <renderer-v2 type="singleSymbol" enableorderby="0" forceraster="0" symbollevels="0" referencescale="-1">
  <symbols>
   <symbol type="fill" name="0" alpha="1" clip_to_extent="1" force_rhr="0">
    <layer class="SimpleFill" enabled="1" locked="0" pass="0">
     <Option type="Map">
      <Option name="color" type="QString" value="0,0,0,0"/>
      <Option name="style" type="QString" value="no"/>
      <Option name="outline_color" type="QString" value="20,60,20,255"/>
      <Option name="outline_style" type="QString" value="solid"/>
      <Option name="outline_width" type="QString" value="0.6"/>
      <Option name="outline_width_unit" type="QString" value="MM"/>
     </Option>
    </layer>
   </symbol>
  </symbols>
 </renderer-v2>
 <labeling type="simple">
  <settings calloutType="simple">
   <text-style fieldName="&quot;name&quot; || '\n' || if(&quot;area_m2&quot; &lt; 1000, format_number(&quot;area_m2&quot;, 0) || ' m²', format_number(&quot;area_m2&quot; / 10000, 2) || ' ha')" isExpression="1" fontSize="10" fontSizeUnit="Point" fontFamily="Sans" textColor="30,30,30,255">
    <text-buffer bufferDraw="1" bufferSize="1" bufferSizeUnits="MM" bufferColor="255,255,255,220"/>
   </text-style>
  </settings>
 </labeling>
 <mapTip enabled="1">&lt;b&gt;[% &quot;name&quot; %]&lt;/b&gt;, [% coalesce(format_number(&quot;area_m2&quot;, 0), '?') %] m², [% &quot;sessions&quot; %] sessions, last on [% coalesce(format_date(&quot;last_date&quot;, 'yyyy-MM-dd'), '?') %]</mapTip>
</qgis>
